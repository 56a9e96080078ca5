"""Circles and ellipses in space, the axes of their surfaces, and the occluding contours."""
