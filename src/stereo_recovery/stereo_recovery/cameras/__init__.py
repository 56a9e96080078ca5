"""Calibrated rigs from files, raw images made into rectified ones, and a camera's noise."""
