"""The things on the bench: their drivers, their physics, their simulated twins."""
