"""Fit, diagnose or accept many recordings in parallel, on a Dask cluster or on this machine's cores."""
