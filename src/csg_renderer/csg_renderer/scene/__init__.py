"""Solids, surfaces, terrains and lights: what a scene is made of."""
