"""Climate chambers, one file a model: a declared table of registers and a few hooks."""
