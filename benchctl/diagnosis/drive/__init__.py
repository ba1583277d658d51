"""A table's drive as a problem for the engine."""
