"""Scenes of the BOP benchmark and requests of the bin-picking challenge (BPC): read, answered and written."""
