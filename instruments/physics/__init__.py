"""Physical models of the bench: pure functions on arrays."""
