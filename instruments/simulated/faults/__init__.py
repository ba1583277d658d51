"""Scheduled faults of the simulated bench: of its links, its instruments and its stream."""
