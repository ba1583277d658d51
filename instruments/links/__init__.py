"""Links that carry bytes: TCP, Modbus and serial lines, with time-outs, one reconnect policy and a wire log."""
