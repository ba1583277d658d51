"""Pictures of the entries: effects drawn by the project's own physics, switched on and off; metrics by made data."""
