"""Pictures of a scene: rays, tiles, shading, three engines with one answer, and the sensor."""
