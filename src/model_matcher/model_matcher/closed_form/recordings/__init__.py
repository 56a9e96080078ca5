"""Recordings: stereo pairs out of anybody's bags, and results into files that others open, without ROS running."""
