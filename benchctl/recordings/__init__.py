"""Recordings: the HDF5 schema, writing, reading, digests, importing and exporting."""
