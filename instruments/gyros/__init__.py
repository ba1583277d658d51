"""Gyros with a digital output, one file a model: a declared frame and a few hooks."""
