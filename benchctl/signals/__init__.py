"""Signals of a recording: motion from an encoder, temperatures, spectra, and the arithmetic that rows need."""
