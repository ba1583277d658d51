"""Signals of a recording made into rows: motion from an encoder, temperatures, and the arithmetic that rows need."""
