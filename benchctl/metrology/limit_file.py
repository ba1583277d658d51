"""The file of limits: the permitted range of each result with its unit, and the guard band.

title = "Acceptance of VG910"
guard = 1.0                      # guard band in expanded uncertainties (95.45 %); 0: simple acceptance

[settings]                       # what belongs to the tests' definitions
low_rate_dps = 40.0

[limits.scale_factor]
low = 49.5
high = 50.5
unit = "mV/(deg/s)"              # "1" for a digital gyro, whose scale factor is a number near 1
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from pydantic import Field, model_validator

from benchctl.closeness import meant
from benchctl.limits import shown
from benchctl.metrology.names import RATE_UNITS, UNITS
from benchctl.metrology.observations import Settings
from benchctl.metrology.result import Limit, Papers
from benchctl.tables import Table
from benchctl.toml_file import line_of, parse_toml, read_text
from benchctl.units import factor_between
from benchctl_instruments.errors import UsageError


class _LimitEntry(Table):
    low: float | None = None
    high: float | None = None
    unit: str = Field(min_length=1)

    @model_validator(mode="after")
    def _in_order(self) -> _LimitEntry:
        if self.low is None and self.high is None:
            raise ValueError("expected low, high or both")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low ({self.low:g}) must not be above high ({self.high:g})")
        return self


class LimitFile(Papers):
    """A file of limits, as written."""

    guard: float = Field(default=1.0, ge=0)
    settings: Settings = Settings()
    limits: dict[str, _LimitEntry] = Field(min_length=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """A file of limits: the limits by test name, each in its own unit, and the other entries."""

    path: Path
    text: str
    sha256: str
    guard: float
    limits: Mapping[str, Limit]
    settings: Settings
    papers: Papers


def read_limits(path: Path) -> Limits:
    """Read a file of limits.

    Raises
    ------
    UsageError
        If it is missing or not TOML, or names an unknown test or an impossible unit; the message states the line.
    """
    return limits_of_text(read_text(path, "limits"), path)


def limits_of_text(text: str, path: Path) -> Limits:
    """Return the limits of a text that was already read; raises the errors of `read_limits`."""
    content = parse_toml(text, LimitFile, str(path))
    for name, entry in content.limits.items():
        if name not in UNITS:
            raise UsageError(f"{path}, line {line_of(text, ('limits', name))}: {_unknown(name)}")
        if entry.unit == RATE_UNITS.get(name):
            continue
        try:
            factor_between(UNITS[name], entry.unit)
        except ValueError as err:
            line = line_of(text, ("limits", name, "unit"))
            raise UsageError(f"{path}, line {line}: limits.{name}.unit: {err}") from err
    return Limits(
        path=path,
        text=text,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        guard=content.guard,
        limits={name: Limit(low=one.low, high=one.high, unit=one.unit) for name, one in content.limits.items()},
        settings=content.settings,
        papers=Papers(**content.model_dump(include=set(Papers.model_fields))),
    )


def _unknown(name: str) -> str:
    return f"there is no test {shown(name)}: {meant(name, UNITS)}"


def limits_template() -> str:
    """Return a commented limits.toml that the simulated gyro passes."""
    return files("benchctl.metrology").joinpath("limits.toml").read_text(encoding="utf-8")


def acceptance_test_template() -> str:
    """Return an acceptance.bench-test.toml, for a folder with a bench.toml and a limits.toml."""
    return files("benchctl.metrology").joinpath("acceptance_test.toml").read_text(encoding="utf-8")
