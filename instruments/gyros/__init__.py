"""Drivers of gyros with a digital output, one module per model: a declared frame and a few hooks."""
