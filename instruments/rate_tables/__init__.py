"""Rate tables, one file a model: a declared table of commands and a few hooks."""
