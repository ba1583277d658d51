"""Sealed trials: concealed physics is drawn, run through the bench's wires, diagnosed blind, unsealed and scored."""
