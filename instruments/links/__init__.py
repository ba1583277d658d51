"""Bytes in, bytes out: TCP, Modbus, serial lines; time-outs, one reconnect policy, a log of the wire."""
