"""Built-in help: a description of each effect, metric and term, with its equation and sources."""
