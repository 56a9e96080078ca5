"""Finds known objects among recovered 3D features: interpretation search, validation, closed-form testing."""
