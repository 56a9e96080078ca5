"""One least squares of all straight edges: what its statements are, which hold, and how it is solved."""
