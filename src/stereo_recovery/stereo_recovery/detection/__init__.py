"""One image: edgels, chains, straight segments, conics and junctions, each with its uncertainty."""
