"""The production search: poses from pairs of features."""
