"""The guard: a separate process that brings the bench to rest if the runner no longer can."""
