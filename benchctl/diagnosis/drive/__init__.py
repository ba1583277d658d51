"""A table's drive as a diagnosis problem."""
