"""All settings of the simulated bench, with plain defaults; the `[simulated]` table of bench.toml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber import ChamberParameters
from benchctl_instruments.physics.encoder import EncoderParameters
from benchctl_instruments.physics.gyro import GyroParameters
from benchctl_instruments.physics.response_gyro import ResponseParameters
from benchctl_instruments.physics.table import TableParameters
from benchctl_instruments.physics.three_axes import ThreeAxisParameters

_Settings = TypeVar("_Settings")

_LOWEST_CUTOFF_HZ = 0.2
"""Slower electronics would need a longer history of the motion than the simulated bench keeps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldSettings:
    """The parts of the simulated bench and its location.

    If a `response` is given, the gyro follows it exactly, in place of `gyro`. If `three_axes` are given, a digital gyro
    is that unit.
    `thermistor_v_per_c` and `thermistor_offset_v` are the amplifier's scale: volts = slope·°C + offset. `grid_hz` is
    the internal rate at which the gyro's electronics are computed. The same `seed` gives the same noise.
    """

    gyro: GyroParameters = field(default_factory=GyroParameters)
    table: TableParameters = field(default_factory=TableParameters)
    encoder: EncoderParameters = field(default_factory=EncoderParameters)
    chamber: ChamberParameters = field(default_factory=ChamberParameters)
    response: ResponseParameters | None = None
    three_axes: ThreeAxisParameters | None = None
    latitude_deg: float = 58.5
    room_c: float = 23.0
    thermistor_v_per_c: float = 0.05
    thermistor_offset_v: float = 0.0
    grid_hz: float = 2000.0
    seed: int = 1

    def __post_init__(self) -> None:
        if self.gyro.cutoff_hz < _LOWEST_CUTOFF_HZ:
            raise UsageError(
                f"the gyro's cutoff_hz is {self.gyro.cutoff_hz}: the simulated bench needs {_LOWEST_CUTOFF_HZ} or more"
            )
        if self.grid_hz < 4.0 * self.gyro.cutoff_hz:
            raise UsageError(
                f"grid_hz is {self.grid_hz}; give at least four times the gyro's cutoff_hz, {self.gyro.cutoff_hz}"
            )
        if not -90.0 <= self.latitude_deg <= 90.0:
            raise UsageError(f"latitude_deg is {self.latitude_deg}; give -90 to 90")
        if self.seed < 0:
            raise UsageError(f"seed is {self.seed}; give an integer, 0 or more")

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], *, where: str = "simulated") -> WorldSettings:
        """Return settings from nested mappings, as parsed from TOML; missing fields keep their defaults.

        Raises `UsageError`, naming `[where.table] field`, for an unknown field or a value of the wrong type.
        """
        return built(cls, mapping, where)

    def drawn(self, seed: int) -> WorldSettings:
        """Return another bench of the same make: new noise, the encoder mounted differently, the same coefficients."""
        first_deg, second_deg = np.random.default_rng(seed).uniform(0.0, 360.0, 2)
        mounted = replace(
            self.encoder, eccentricity_phase_deg=float(first_deg), ellipticity_phase_deg=float(second_deg)
        )
        return replace(self, encoder=mounted, seed=seed)


def built(cls: type[_Settings], mapping: Mapping[str, Any], where: str) -> _Settings:
    """Return a dataclass of numbers, tuples of numbers and such dataclasses from parsed TOML.

    Raises `UsageError`, naming `[where] field`, for an unknown or missing field, or a value of the wrong type.
    """
    types = get_type_hints(cls)
    items = fields(cls)  # type: ignore[arg-type]  # no bound expresses "a dataclass"
    known = [item.name for item in items]
    values = {}
    for name, value in mapping.items():
        if name not in known:
            raise UsageError(f"[{where}] {name}: no such field; there are {', '.join(known)}")
        values[name] = _checked(types[name], value, where, name)
    for item in items:
        if item.default is MISSING and item.default_factory is MISSING and item.name not in values:
            raise UsageError(f"[{where}] {item.name}: this field is needed and is not there")
    try:
        return cls(**values)
    except UsageError as err:  # concerns several numbers together
        raise UsageError(f"[{where}] {err}") from err


def _checked(wanted: Any, value: object, where: str, name: str) -> object:
    if isinstance(wanted, UnionType):  # X | None: a given value is an X
        wanted = get_args(wanted)[0]
    if get_origin(wanted) is tuple:
        if not isinstance(value, list | tuple):
            raise UsageError(f"[{where}] {name}: expected a list of numbers, got {value!r}")
        return tuple(_checked(float, entry, where, name) for entry in value)
    if isinstance(wanted, type) and is_dataclass(wanted):
        if not isinstance(value, Mapping):
            raise UsageError(f"[{where}] {name}: expected a table [{where}.{name}], got {value!r}")
        return built(wanted, value, f"{where}.{name}")
    accepted = (int,) if wanted is int else (int, float)
    if isinstance(value, bool) or not isinstance(value, accepted) or not math.isfinite(value):
        expected = "an integer" if wanted is int else "a finite number"
        raise UsageError(f"[{where}] {name}: expected {expected}, got {value!r}")
    return wanted(value)
