"""The tests of a gyro, one module per kind: each yields results from the observations, or states what is missing."""
