"""Test automation for gyroscopes on a rate table in a climate chamber."""

__version__ = "0.1.0"
