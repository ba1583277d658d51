"""Fit models to the rows of a recording, and estimate the noise that weights them.

A `problem` is a measured quantity with a model of it; `fit` fits the model's parameters and those of effects jointly,
with the `noise` model that whitens residuals; `linear` is linear least squares.
"""
