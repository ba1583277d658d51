"""Wire protocols without I/O: bytes to messages and back, one module per protocol."""
