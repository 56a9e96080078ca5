"""Straight edges in space."""
