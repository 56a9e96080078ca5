"""Certificates that no interpretation explains more of the data."""
