"""Digitizers, one file a model; each samples encoder, gyro and thermistor in one hardware scan."""
