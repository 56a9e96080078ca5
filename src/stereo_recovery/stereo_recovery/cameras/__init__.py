"""Calibrated rigs from files, and raw images made into rectified ones."""
