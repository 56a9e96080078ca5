"""What a scene is to the engines: leaves, operators and surfaces, in arrays, and what of them can be left out."""
