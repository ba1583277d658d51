"""The serial ports of this machine, and those that a bench names."""
