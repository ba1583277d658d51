"""A chamber as a problem for the engine."""
