"""Thresholds of rays and triangles."""

from __future__ import annotations

# Triangles that one box of the hierarchy holds at most: below that a test of a box costs what it saves.
LEAF = 4
# Places along each axis at which a node of the hierarchy may be cut.
BINS = 16
# Barycentric coordinate down to which a ray still meets a triangle: rounding leaves no gap between two of them.
RIM = 1e-9
# Component of a ray, metres, that is divided by as if it were this: its inverse is a number still.
NO_DIRECTION = 1e-300
# Bytes of the largest mesh file that is read, half a million triangles of binary STL: text takes trimesh a second for
# every ten million bytes.
LARGEST_MESH = 2**25
