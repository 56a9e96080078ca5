"""Features of models and views, from solids and meshes, as data, drawings and files."""
