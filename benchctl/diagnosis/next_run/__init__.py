"""The next experiment: which run would settle what a recording leaves open."""
