"""Straight edges in space: where they end, what corners and further cameras say, and which are reported."""
