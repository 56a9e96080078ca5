"""Which segment of the right image is which of the left."""
