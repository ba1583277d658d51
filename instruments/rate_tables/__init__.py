"""Drivers of rate tables, one module per model: a declared table of commands and a few hooks."""
