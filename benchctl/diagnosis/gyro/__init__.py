"""The gyro as a problem for the engine: the lab's model on the samples of a recording, or on a table of points."""
