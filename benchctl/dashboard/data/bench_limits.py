"""The limits of a campaign's bench and its interlocks, and how far what is measured is from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchctl.bench import Bench
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
    """What a quantity may be; None: as much as it likes, on that side."""

    quantity: str
    low: float | None
    high: float | None

    def as_json(self) -> dict[str, Any]:
        """What the page is told of it."""
        return {"quantity": self.quantity, "unit": _UNITS[self.quantity], "low": self.low, "high": self.high}

    def held_against(self, value: float | None) -> dict[str, Any]:
        """The same with the value now and its margin: see `margin`."""
        margin = None if value is None else self.margin(value)
        return self.as_json() | {"value": value, "margin": margin}

    def margin(self, value: float) -> float:
        """How much is left of the way to the nearer limit, 1 the most; negative beyond it.

        The way is from the middle between two limits; to a limit that stands alone, from zero.
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
    """The bench that a campaign is, or was, run on; None where it keeps none, as imports do."""
    if not meta.provenance.get("bench_toml"):
        return None
    from benchctl.campaign.provenance import recorded_bench  # it opens benches: seconds to import

    try:
        return recorded_bench(meta, "the campaign")
    except UsageError:  # written by a later version, or changed: the page does without
        return None


def limits_of(bench: Bench | None) -> list[BenchLimit]:
    """Its limits, then its interlocks in the order of bench.toml."""
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
    """What is known now of a quantity of bench.toml, from the values that a follower has."""
    if quantity == "setpoint_error_c":
        air_c, setpoint_c = values.get("air_c"), values.get("setpoint_c")
        return None if air_c is None or setpoint_c is None else air_c - setpoint_c
    return values.get("rate_dps" if quantity == "encoder_dps" else quantity)
