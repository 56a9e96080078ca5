"""Recovers 3D edges, curves and axes with stated uncertainty from a stereo pair."""
