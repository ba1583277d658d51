"""The tests of a gyro, one file a kind: each gives results from the observations, or states what is missing."""
