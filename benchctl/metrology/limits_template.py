"""Commented files to start from: limits that the simulated gyro as it stands passes, and a test for pytest by them."""

from __future__ import annotations

from importlib.resources import files


def limits_template() -> str:
    """The text of a limits.toml."""
    return files("benchctl.metrology").joinpath("limits.toml").read_text(encoding="utf-8")


def acceptance_test_template() -> str:
    """The text of an acceptance.bench-test.toml, for a folder with a bench.toml and a limits.toml."""
    return files("benchctl.metrology").joinpath("acceptance_test.toml").read_text(encoding="utf-8")
