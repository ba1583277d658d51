"""The simulated bench: servers that implement the real protocols on simulated physics, with one clock."""
