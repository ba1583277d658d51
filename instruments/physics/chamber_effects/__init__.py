"""Physics of a chamber's air that one time constant leaves out: one file an effect."""
