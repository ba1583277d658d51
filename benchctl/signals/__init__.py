"""From the channels of a recording to what analyses work on.

`segments` reads a step as runs without a gap, `rate` makes the encoder's rate, `motion` the motion behind every sample,
`reduce` the block means of a step. Beside them: temperatures, spectra, and the arithmetic that rows need.
"""
