"""Presentation of a selection: findings, where model and recording disagree, effects not found, and the verdict."""
