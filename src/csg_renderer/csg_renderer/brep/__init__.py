"""Boundary evaluation: the exact edges, curves, faces and axes of a solid, straight from its tree."""
