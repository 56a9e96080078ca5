"""A known object followed from image to image: predicted, measured in the images, and given up when they say so."""
