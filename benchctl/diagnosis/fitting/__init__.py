"""Joint fits: the noise that weighs the rows, the fit itself, and what a better noise model owes to it."""
