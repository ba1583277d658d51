"""The tests of a gyro, one file a kind: each takes what a recording shows and gives results, or says what it lacks."""
