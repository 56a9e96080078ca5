"""Triangle meshes: their files and units, how triangles meet, and the hierarchy of boxes that rays go down."""
