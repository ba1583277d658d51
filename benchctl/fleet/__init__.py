"""Many recordings fitted, diagnosed or accepted at once, on a Dask cluster or on this machine's cores."""
