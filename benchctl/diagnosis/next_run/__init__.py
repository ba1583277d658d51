"""The next experiment: the run that would decide what a recording leaves open."""
