"""Effects on a chamber's air that a single time constant does not describe; one module per effect."""
