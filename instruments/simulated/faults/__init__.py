"""Faults of the simulated bench, played when a schedule says so: on its links, in its instruments, in its stream."""
