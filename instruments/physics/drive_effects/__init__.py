"""Effects on a table's drive that inertia and viscous friction do not describe; one module per effect."""
