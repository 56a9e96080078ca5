"""Compiled geometry of lines and rigid motions, without any policy."""
