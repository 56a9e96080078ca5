"""Features of objects whose poses are known, made without pictures."""
