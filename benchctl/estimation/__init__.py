"""What the data say: fits of a model to rows of a recording, and the noise that weighs them.

A `problem` is a measured quantity with a model of it; `fit` fits the model's parameters and those of effects jointly,
with the `noise` that makes residuals white; `linear` is least squares where all is linear.
"""
