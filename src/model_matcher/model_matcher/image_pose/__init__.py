"""The pose measured in the images: what is visible of a model at a pose, looked for in every view."""
