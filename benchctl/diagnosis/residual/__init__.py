"""The unexplained residual: where it occurs, and which effects may be named in spite of it."""
