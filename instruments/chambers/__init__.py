"""Drivers of climate chambers, one module per model: a declared table of registers and a few hooks."""
