"""Physics of a table's drive that inertia and viscous friction leave out: one file an effect."""
