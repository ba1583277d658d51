"""What the bench obeys: pure functions on arrays."""
