"""A chamber as a diagnosis problem."""
