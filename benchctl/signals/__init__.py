"""Signals of a recording: what several parts of the suite compute from evenly sampled channels."""
