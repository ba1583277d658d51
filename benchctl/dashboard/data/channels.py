"""The channels that a page can draw: those that are recorded, and those that are made from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from benchctl.dashboard.data.rates import WINDOW_S
from benchctl.recordings.model import AXES, DESCRIPTIONS, Meta, axis_of
from benchctl.recordings.schema import unit_of

RATE = "rate_dps"
ANGLE = "encoder_deg"


@dataclass(frozen=True, slots=True)
class Made:
    """A channel that no step records under its name: in each step the first of `of` that is there."""

    of: tuple[str, ...]
    unit: str
    says: str


MADE = {
    RATE: Made(
        (ANGLE,),
        "degree/s",
        f"rate of the table by its encoder: the angle's change over {WINDOW_S:g} s, or over two samples if longer",
    ),
    "air_c": Made(("poll_chamber_temp_c", "chamber_temp_c"), "degC", "air of the chamber"),
    "setpoint_c": Made(("poll_chamber_setpoint_c",), "degC", "set point of the chamber"),
    "gyro_c": Made(("gyro_temp_c", "poll_gyro_temp_c"), "degC", "thermistor in the housing of the gyro"),
}
"""What a page asks for by one name, whatever the step recorded it under."""


def recorded_as(channel: str, names: Iterable[str]) -> str | None:
    """Under which of a step's names a channel is recorded, or what it is made from; None: not in this step."""
    there = set(names)
    if channel in there and channel not in AXES:
        return channel
    return next((name for name in MADE[channel].of if name in there), None) if channel in MADE else None


def described(names: Iterable[str], meta: Meta) -> list[dict[str, str]]:
    """Name, unit, meaning and axis of each channel that steps with these names give, the made ones first."""
    there = [name for name in dict.fromkeys(names) if name not in AXES]
    made = [
        {"name": name, "unit": one.unit, "says": one.says, "axis": axis_of(next(of for of in one.of if of in there))}
        for name, one in MADE.items()
        if name not in there and any(of in there for of in one.of)
    ]
    recorded = [
        {
            "name": name,
            "unit": unit_in_words(name, meta),
            "says": meta.extra.get("channel_comments", {}).get(name) or DESCRIPTIONS.get(name, ""),
            "axis": axis_of(name),
        }
        for name in there
    ]
    return [*made, *recorded]


def unit_in_words(channel: str, meta: Meta) -> str:
    """The unit of a channel, empty where it is not known; the gyro's output may be of another than volts."""
    if channel in MADE:
        return MADE[channel].unit
    if channel == "gyro_v":
        return meta.output_unit
    return unit_of(channel, meta) or ""
