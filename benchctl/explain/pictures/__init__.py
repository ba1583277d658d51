"""Pictures of the entries: effects simulated with and without the effect; metrics from synthetic data."""
