"""Models for unnamed dependences in the residual: the simplest shape over a coordinate, reported with its formula."""
