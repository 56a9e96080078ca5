"""The rays of a tile on the array machine: entry and exit, set operators and terrains, one ray a PE."""
