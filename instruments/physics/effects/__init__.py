"""Effects that a simulation may omit, shared by the simulated bench and the diagnosis; one module per effect."""
