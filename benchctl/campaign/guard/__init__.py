"""The guard: a process beside the runner that brings the bench to rest where the runner no longer can."""
