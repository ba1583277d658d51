"""Figures, HTML pages and text output of the results."""
