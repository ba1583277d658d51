"""The details of one campaign: its plan, steps, channels, bench limits and provenance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.bench import Bench
from benchctl.dashboard.data.channels import described
from benchctl.dashboard.data.contents import StepInFile, contents_of
from benchctl.dashboard.data.events import lines_after
from benchctl.dashboard.data.run_state import RunState
from benchctl.recordings.model import Meta
from benchctl_instruments.errors import UsageError

_UNITS = {
    "rate_dps": "degree/s",
    "acceleration_dps2": "degree/s²",
    "angle_deg": "degree",
    "air_c": "degC",
    "setpoint_c": "degC",
    "setpoint_error_c": "degC",
    "power_percent": "%",
    "gyro_c": "degC",
    "gyro_v": "V",
    "encoder_dps": "degree/s",
}
"""The units of the quantities, by their names in bench.toml."""


@dataclass(frozen=True, slots=True)
class BenchLimit:
    """The allowed range of a quantity; None: no limit on that side."""

    quantity: str
    low: float | None
    high: float | None

    def as_json(self) -> dict[str, Any]:
        """Return the data for the page."""
        return {"quantity": self.quantity, "unit": _UNITS[self.quantity], "low": self.low, "high": self.high}

    def held_against(self, value: float | None) -> dict[str, Any]:
        """Return the data with the current value and its margin: see `margin`."""
        margin = None if value is None else self.margin(value)
        return self.as_json() | {"value": value, "margin": margin}

    def margin(self, value: float) -> float:
        """Return the relative distance to the nearer limit, at most 1; negative beyond it.

        The distance is relative to half the range between two limits, or to the size of a single limit.
        """
        ways = []
        if self.high is not None:
            way = (self.high - self.low) / 2 if self.low is not None else abs(self.high)
            ways.append((self.high - value) / (way or 1.0))
        if self.low is not None:
            way = (self.high - self.low) / 2 if self.high is not None else abs(self.low)
            ways.append((value - self.low) / (way or 1.0))
        return min([1.0, *ways])


def bench_of(meta: Meta) -> Bench | None:
    """Return the bench that a campaign is or was run on; None if the recording does not contain it, as in imports."""
    if not meta.provenance.get("bench_toml"):
        return None
    from benchctl.campaign.provenance import recorded_bench  # it imports the instruments, which takes seconds

    try:
        return recorded_bench(meta, "the campaign")
    except UsageError:  # from a later version, or changed: the page does not need it
        return None


def limits_of(bench: Bench | None) -> list[BenchLimit]:
    """Return its limits, then its interlocks in the order of bench.toml."""
    if bench is None:
        return []
    limits = bench.limits
    return [
        BenchLimit("rate_dps", -limits.rate_dps, limits.rate_dps),
        BenchLimit("acceleration_dps2", -limits.acceleration_dps2, limits.acceleration_dps2),
        BenchLimit("air_c", limits.coldest_c, limits.hottest_c),
        *(BenchLimit(one.quantity, one.below, one.above) for one in bench.interlocks),
    ]


def measured(values: Mapping[str, float | None], quantity: str) -> float | None:
    """Return the current value of a quantity of bench.toml, from the values of a follower."""
    if quantity == "setpoint_error_c":
        air_c, setpoint_c = values.get("air_c"), values.get("setpoint_c")
        return None if air_c is None or setpoint_c is None else air_c - setpoint_c
    return values.get("rate_dps" if quantity == "encoder_dps" else quantity)


_LONGEST = 300
"""Longer texts of the provenance are documents, such as bench.toml, and not shown in a table."""


def details_of(path: Path) -> dict[str, Any]:
    """Return plan, steps, channels, end, limits, provenance, notes and digest of a campaign, for the page.

    `plan` has planned bench times and, as `began_s`, the actual start of each step; it is empty if the recording
    contains none. Times of `steps` are those of the recording. Raises `UsageError` if the campaign cannot be read.
    """
    contents = contents_of(path)
    state = RunState()
    state.take(event for _, event in lines_after(path, 0) if event is not None)
    names = dict.fromkeys(name for piece in contents.pieces for name in piece.channels)
    return {
        "plan": [step.as_json(state.begun.get(step.index)) for step in state.plan],
        "steps": [_step(piece) for piece in contents.pieces],
        "channels": described(names, contents.meta),
        "t_end_s": contents.t_end_s,
        "limits": [limit.as_json() for limit in limits_of(bench_of(contents.meta))],
        "provenance": _provenance(contents.meta),
        "notes": list(contents.notes),
        "digest": contents.digest,
    }


def _step(piece: StepInFile) -> dict[str, Any]:
    info = piece.info
    return {
        "index": info.index,
        "name": info.name,
        "kind": info.kind,
        "role": info.role,
        "whole": bool(info.whole),
        "t_start_s": info.t_start,
        "t_end_s": info.t_end,
        "samples": info.samples,
        "gaps": info.gaps,
        "rate_dps": info.rate_dps,
        "amplitude_dps": info.amplitude_dps,
        "frequency_hz": info.frequency_hz,
        "setpoint_c": info.chamber_setpoint_c if math.isfinite(info.chamber_setpoint_c) else None,
        "mounting": info.mounting,
    }


def _provenance(meta: Meta) -> dict[str, str]:
    """Return the texts that are short enough to be shown."""
    return {name: text for name, text in meta.provenance.items() if text and len(text) <= _LONGEST}
