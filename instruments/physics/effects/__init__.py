"""Physics that a simulation may leave out: one file an effect, the same for the simulated bench and the diagnosis."""
