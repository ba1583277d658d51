"""Wire protocols without I/O: bytes to messages and back, one file a protocol."""
