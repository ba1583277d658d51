"""The gyro as a diagnosis problem: the lab's model for the samples of a recording, or for a table of points."""
