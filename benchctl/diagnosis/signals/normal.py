"""Numbers of the normal distribution."""

Z95 = 1.959964
"""So many deviations on either side hold 95 %."""
QUARTILE = 0.67449
"""So many deviations on either side hold half: the median of what is normal, without its sign."""
DEVIATION_OF_MEDIAN = 1.4826
"""A deviation over the median of what is normal, without its sign."""
