"""Sealed trials: draw concealed physics, simulate and record it, diagnose the recording blind, unseal and score."""
