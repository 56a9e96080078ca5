"""What is known of a model and of the data before any search."""
