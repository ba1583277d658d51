"""Differences between a recording and its predictions, step by step."""
