"""Which parts of edges and contours a camera sees."""
