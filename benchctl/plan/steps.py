"""The steps of a campaign: the actions of the bench, as data.

Steps are independent of the instruments, so that a plan can be checked, timed, drawn, resumed and compared without
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import ClassVar, Literal, get_args

from benchctl.limits import LONGEST_STEP_S, shown
from benchctl_instruments.mounting import Position

Role = Literal["fit", "verify"]
"""`verify` marks a held-out run, which no fit may use."""

_WORDS: Mapping[str, tuple[str, ...]] = {"role": get_args(Role), "position": get_args(Position)}
"""Fields with a fixed set of values."""

_TEXTS = frozenset({"says"})
"""Fields that are a free line of text; all fields not listed here or in `_WORDS` are numbers."""

LONGEST_TEXT = 160
"""The largest number of characters of a line for the operator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseStep:
    """The base class of all steps: the properties that do not depend on a bench."""

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        for field in fields(self):
            value, words = getattr(self, field.name), _WORDS.get(field.name)
            if field.name in _TEXTS:
                _require_line(type(self).__name__, field.name, value)
                continue
            if words is not None and value not in words:
                raise ValueError(f"{type(self).__name__}: {field.name} is {value!r}, expected one of {words}")
            if words is None:
                object.__setattr__(self, field.name, _plain(type(self).__name__, field.name, value))

    @property
    def label(self) -> str:
        """The name shown to the operator."""
        return self.kind

    @property
    def peak_rate_dps(self) -> float:
        """The largest rate of the table."""
        return 0.0

    @property
    def peak_acceleration_dps2(self) -> float:
        """The largest acceleration required by the step itself; the spin-up is adapted to the bench."""
        return 0.0

    @property
    def streamed_s(self) -> float:
        """The duration of streaming by the digitizer."""
        return 0.0


def _plain(step: str, field: str, value: object) -> float:
    """Convert a number of any library to a Python int or float."""
    if not isinstance(value, Real):
        raise TypeError(f"{step}: {field} is {shown(value)}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        raise ValueError(f"{step}: {field} is {shown(value)}, which is too large") from None
    return int(value) if isinstance(value, Integral) else number


def _require_line(step: str, field: str, value: object) -> None:
    if not isinstance(value, str):
        raise TypeError(f"{step}: {field} is {value!r}, expected a text")
    if not value.strip() or not value.isprintable() or len(value) > LONGEST_TEXT:
        raise ValueError(f"{step}: {field} is {value!r}, expected one line of 1 to {LONGEST_TEXT} characters")


@dataclass(frozen=True, slots=True, kw_only=True)
class Soak(BaseStep):
    """Bring the chamber to a set point and wait until the gyro has followed, with the table at rest.

    The soak ends when the air has stayed within `tolerance_c` of the set point for `hold_s` and the gyro's thermistor
    drifts by less than `drift_c_per_min`; it fails if this is not reached within `timeout_s` after the expected arrival
    of the air temperature.
    """

    kind: ClassVar[str] = "soak"

    setpoint_c: float
    hold_s: float
    tolerance_c: float = 0.3
    drift_c_per_min: float = 0.02
    timeout_s: float = 4 * 3600.0

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"soak at {self.setpoint_c:+g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Static(BaseStep):
    """The output at rest."""

    kind: ClassVar[str] = "static"

    duration_s: float
    settle_s: float = 2.0
    role: Role = "fit"

    @property
    def streamed_s(self) -> float:
        """See `BaseStep`."""
        return self.duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantRate(BaseStep):
    """The output at a constant rate; complete revolutions average out Earth's rate, tilt and eccentricity."""

    kind: ClassVar[str] = "constant_rate"

    rate_dps: float
    duration_s: float
    settle_s: float = 2.0
    role: Role = "fit"

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"rate {self.rate_dps:+g}"

    @property
    def peak_rate_dps(self) -> float:
        """See `BaseStep`."""
        return abs(self.rate_dps)

    @property
    def streamed_s(self) -> float:
        """See `BaseStep`."""
        return self.duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Sine(BaseStep):
    """Sinusoidal motion; `amplitude_dps` is the peak of the rate."""

    kind: ClassVar[str] = "sine"

    amplitude_dps: float
    frequency_hz: float
    cycles: int
    settle_cycles: int = 2
    role: Role = "fit"

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"sine {self.amplitude_dps:g} at {self.frequency_hz:g} Hz"

    @property
    def peak_rate_dps(self) -> float:
        """See `BaseStep`."""
        return abs(self.amplitude_dps)

    @property
    def peak_acceleration_dps2(self) -> float:
        """See `BaseStep`."""
        return abs(self.amplitude_dps) * 2 * math.pi * self.frequency_hz

    @property
    def streamed_s(self) -> float:
        """See `BaseStep`."""
        return self.cycles / self.frequency_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalRamp(BaseStep):
    """Ramp the chamber from its present temperature to `to_c` while the table moves and the digitizer streams.

    The table either turns at `rate_dps` or swings with the peak rate `swing_dps`. Swinging shows scale factor and bias
    at every temperature; turning covers every heading.
    """

    kind: ClassVar[str] = "thermal_ramp"

    from_c: float
    to_c: float
    ramp_c_per_min: float
    rate_dps: float = 0.0
    swing_dps: float = 0.0
    swing_hz: float = 0.2
    settle_s: float = 2.0
    role: Role = "fit"

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"ramp to {self.to_c:+g}"

    @property
    def peak_rate_dps(self) -> float:
        """See `BaseStep`."""
        return max(abs(self.rate_dps), abs(self.swing_dps))

    @property
    def peak_acceleration_dps2(self) -> float:
        """See `BaseStep`."""
        return abs(self.swing_dps) * 2 * math.pi * self.swing_hz

    @property
    def streamed_s(self) -> float:
        """See `BaseStep`."""
        return abs(self.to_c - self.from_c) / self.ramp_c_per_min * 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCycle(BaseStep):
    """Switch the unit's supply off for `off_s`, then on again, with the table at rest.

    The step ends when the supply is on. The unit is on before the first step and after every step.
    """

    kind: ClassVar[str] = "power_cycle"

    off_s: float = 60.0

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return "power cycle"


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount(BaseStep):
    """Mount the unit with its input axis along the table's axis (the initial position) or across it.

    A unit of three axes is turned so that one of them points up or down: "x up", "x down" and so on.
    """

    kind: ClassVar[str] = "mount"

    position: Position

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"mount {self.position}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask(BaseStep):
    """Ask the operator to do something, with the table at rest, and wait until it is done.

    `says` is the instruction, such as "close the chamber's door". A resumed run repeats the question only if it was not
    answered before.
    """

    kind: ClassVar[str] = "ask"

    says: str

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"ask: {self.says}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Home(BaseStep):
    """Turn the table to its home mark, from which its angle then counts; the operator is asked to permit it first."""

    kind: ClassVar[str] = "home"


ByHand = PowerCycle | Mount | Ask | Home
"""Steps performed, or permitted, by the operator."""

Step = Soak | Static | ConstantRate | Sine | ThermalRamp | PowerCycle | Mount | Ask | Home

Polled = Soak | PowerCycle | Mount | Ask | Home
"""Steps without streaming: only polled values are recorded."""

_POSITIVE = frozenset(
    {
        "amplitude_dps",
        "cycles",
        "drift_c_per_min",
        "duration_s",
        "frequency_hz",
        "off_s",
        "ramp_c_per_min",
        "swing_hz",
        "timeout_s",
        "tolerance_c",
    }
)
_NOT_NEGATIVE = frozenset({"settle_s", "settle_cycles", "hold_s", "swing_dps"})


def faults(step: Step) -> Iterator[str]:
    """Yield faults of a step that are independent of the bench: numbers not finite, not positive, or too large."""
    found = False
    for field in fields(step):
        value = getattr(step, field.name)
        if field.name in _WORDS or field.name in _TEXTS:
            continue
        fault = ""
        if not math.isfinite(value):
            fault = f"{value}, expected a finite number"
        elif field.name in _POSITIVE and value <= 0:
            fault = f"{value:g}, expected more than 0"
        elif field.name in _NOT_NEGATIVE and value < 0:
            fault = f"{value:g}, expected 0 or more"
        elif field.name.endswith("_s") and value > LONGEST_STEP_S:
            fault = f"{value:g}, expected at most {LONGEST_STEP_S:.0f}, a year"
        if fault:
            found = True
            yield f"{field.name} is {fault}"
    if not found and step.streamed_s > LONGEST_STEP_S:
        yield f"streams for {step.streamed_s:g} s, expected at most {LONGEST_STEP_S:.0f}, a year"
    if isinstance(step, ThermalRamp) and step.rate_dps and step.swing_dps:
        yield f"rate_dps is {step.rate_dps:g} and swing_dps {step.swing_dps:g}, expected one of them"


def positions(steps: Sequence[Step]) -> Iterator[Position]:
    """Yield the mounting position of the unit during each step; for a `Mount`, the position after it."""
    position: Position = "along"
    for step in steps:
        if isinstance(step, Mount):
            position = step.position
        yield position
