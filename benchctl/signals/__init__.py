"""Derive the quantities that analyses use from the channels of a recording.

`segments` reads a step as runs without a gap, `rate` computes the encoder's rate, `motion` the motion at every sample,
`reduce` the block means of a step. Other modules provide temperatures, spectra, and arithmetic on rows.
"""
