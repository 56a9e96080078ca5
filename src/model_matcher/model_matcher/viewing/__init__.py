"""What was seen and found as a page for a browser: images with lines drawn over them, and a view in space."""
