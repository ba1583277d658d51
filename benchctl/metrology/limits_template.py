"""A commented file of limits to start from; the simulated gyro as it stands passes it."""

from __future__ import annotations

from importlib.resources import files


def limits_template() -> str:
    """Its text."""
    return files("benchctl.metrology").joinpath("limits.toml").read_text(encoding="utf-8")
