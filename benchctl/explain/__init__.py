"""Help that is built in: an effect, a metric or a term in words, with its equation, sources and picture."""
