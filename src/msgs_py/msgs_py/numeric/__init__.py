"""Numerical helpers of all packages: compiled functions with a shared cache, and groups of linked items."""
