"""Drivers of digitizers, one module per model; each samples encoder, gyro and thermistor in one hardware scan."""
