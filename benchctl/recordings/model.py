"""A recording in memory: the input of the writer, the output of the reader, the data for fits and reports.

A recording is a list of steps. A step holds channels; each channel lies on one of the step's time axes:

- `time_s`: the digitizer's scans (encoder, gyro output, gyro thermistor, in one hardware scan);
- `poll_time_s`: what is polled from time to time (the chamber, and in a soak the gyro), much slower;
- `frame_time_s`: the frames that a digital gyro sends by itself, if the bench has one.

All count seconds from the start of the recording. A soak has only polled channels, and so has an operator's step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from benchctl_instruments.arrays import FloatArray

Status = Literal["running", "complete", "interrupted", "aborted", "imported", "simulated"]
Axis = Literal["time_s", "poll_time_s", "frame_time_s"]
AXES: tuple[Axis, ...] = get_args(Axis)

FRAME_CHANNELS = ("frame_time_s", "frame_rate_dps", "frame_temp_c", "frame_status")
"""The channels of a digital gyro."""

AXIS_CHANNELS = ("frame_rate_x_dps", "frame_rate_y_dps", "frame_rate_z_dps")
"""Those of a unit of three axes, in addition."""

COMPENSATED, COMPENSATED_VALID = "compensated_dps", "compensated_valid"
FRAME_COMPENSATED, FRAME_COMPENSATED_VALID = "frame_compensated_dps", "frame_compensated_valid"
"""The channels that `benchctl apply` adds to a step, at its scans or at a digital gyro's frames."""

AXIS_COMPENSATED = ("frame_compensated_x_dps", "frame_compensated_y_dps", "frame_compensated_z_dps")
"""Those of a unit of three axes, with `frame_compensated_valid`."""

_ON_FRAMES = frozenset({*FRAME_CHANNELS, *AXIS_CHANNELS, FRAME_COMPENSATED, FRAME_COMPENSATED_VALID, *AXIS_COMPENSATED})

UNITS: Mapping[str, str] = {
    "time_s": "s",
    "encoder_deg": "degree",
    "gyro_v": "V",
    "gyro_temp_c": "degC",
    "chamber_temp_c": "degC",
    "poll_time_s": "s",
    "poll_chamber_temp_c": "degC",
    "poll_chamber_setpoint_c": "degC",
    "poll_gyro_temp_c": "degC",
    "poll_gyro_v": "V",
    "poll_frame_temp_c": "degC",
    "frame_time_s": "s",
    "frame_rate_dps": "degree/s",
    "frame_temp_c": "degC",
    "frame_status": "1",
    **dict.fromkeys((*AXIS_CHANNELS, *AXIS_COMPENSATED), "degree/s"),
    COMPENSATED: "degree/s",
    COMPENSATED_VALID: "1",
    FRAME_COMPENSATED: "degree/s",
    FRAME_COMPENSATED_VALID: "1",
}
"""The channels that benchctl records, imports or computes, with their CF units; polled ones begin with `poll_`."""

_SENSED = "sensed rate by the coefficients of the unit, that of the table and of the Earth along the axis"
_WITHIN = "1: the coefficients were measured at such a rate and temperature; 0: not, or there is no rate"

DESCRIPTIONS: Mapping[str, str] = {
    "time_s": "time of the scan since the start of the recording",
    "encoder_deg": "angle of the table, 0 to 360, positive counter-clockwise",
    "gyro_v": "output of the gyro",
    "gyro_temp_c": "thermistor in the housing of the gyro",
    "chamber_temp_c": "air of the chamber",
    "poll_time_s": "time of the poll since the start of the recording",
    "poll_chamber_temp_c": "air of the chamber",
    "poll_chamber_setpoint_c": "set point of the chamber",
    "poll_gyro_temp_c": "thermistor in the housing of the gyro",
    "poll_gyro_v": "output of the gyro",
    "poll_frame_temp_c": "temperature that the digital gyro states",
    "frame_time_s": "time of the digital gyro's sample since the start of the recording",
    "frame_rate_dps": "rate that the digital gyro states, positive counter-clockwise",
    "frame_temp_c": "temperature that the digital gyro states",
    "frame_status": "0: the digital gyro states that the sample is valid; otherwise 256 + the status that it states",
    COMPENSATED: _SENSED,
    COMPENSATED_VALID: _WITHIN,
    **{
        f"frame_rate_{axis}_dps": f"rate that the digital gyro states of its {axis} axis; NaN: not valid"
        for axis in ("x", "y", "z")
    },
    FRAME_COMPENSATED: _SENSED,
    FRAME_COMPENSATED_VALID: _WITHIN,
    **{
        name: f"sensed rate about the {axis} axis of the housing by the coefficients of the unit, that of the table "
        "and of the Earth"
        for axis, name in zip("xyz", AXIS_COMPENSATED, strict=True)
    },
}

BY_HAND = ("power_cycle", "mount", "ask", "home")
"""Kinds of steps that the operator performs, or permits."""
_POLLED_KINDS = ("soak", *BY_HAND)


def axis_of(channel: str) -> Axis:
    """Return the time axis of a channel."""
    if channel in _ON_FRAMES:
        return "frame_time_s"
    return "poll_time_s" if channel.startswith("poll_") else "time_s"


@dataclass(frozen=True, slots=True, kw_only=True)
class StepInfo:
    """The settings of a step and its result; the HDF5 attributes of its group.

    `kind` is `soak`, `static`, `constant_rate`, `sine`, `thermal_ramp`, `power_cycle`, `mount`, `ask` or `home`; of
    imports also `motion` (any movement), `static_points` or `unassigned`. `role` is `fit`, `verify` (held out: no fit
    may use it) or `none` (polled steps, and those of a unit that is not mounted along). `sample_rate_hz` is the actual
    rate of the digitizer, which may differ from the rate that the bench requests. `mounting` is empty while the unit's
    input axis is along the table's axis, otherwise `across`, or for a unit of three axes `x up`, `x down` and so on.
    `t_start` and `t_end` are seconds since the start of the recording; of a power cycle, the times at which the supply
    went off and came on again. `gaps` counts the gaps in the stream. `digest` is empty until the step is closed.
    `frame_rate_hz` is the sample rate of the digital gyro, `frames_lost` the number of its missing frames and
    `frames_bad` the number of frames that failed their check, which are missing, too; None: there is no such gyro.
    """

    index: int
    name: str
    kind: str
    role: str = "fit"
    whole: bool = True
    t_start: float
    t_end: float
    chamber_setpoint_c: float
    rate_dps: float | None = None
    amplitude_dps: float | None = None
    frequency_hz: float | None = None
    sample_rate_hz: float | None = None
    samples: int = 0
    gaps: int = 0
    frame_rate_hz: float | None = None
    frames_lost: int | None = None
    frames_bad: int | None = None
    mounting: str = ""
    digest: str = ""

    @property
    def is_cut_attempt(self) -> bool:
        """Whether a crash or a stop cut the step and it was played again: no fit may use it."""
        return not self.whole and self.role == "none" and self.kind not in _POLLED_KINDS

    @property
    def is_left_out(self) -> bool:
        """Whether no diagnosis may use it: a cut attempt, an operator's step, or a unit not along."""
        return self.is_cut_attempt or bool(self.mounting) or self.kind in BY_HAND


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """The gyro under test; `range_dps` is its rated range."""

    serial: str
    range_dps: float
    model: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchFacts:
    """Facts about the bench that fits need; zero or None: not known. `sample_rate_hz` is what bench.toml requests."""

    sample_rate_hz: float
    encoder_counts_per_rev: int = 0
    encoder_accuracy_arcsec: float = 0.0
    adc_bits: int = 0
    adc_range_v: float = 0.0
    latitude_deg: float | None = None

    @property
    def adc_step_v(self) -> float:
        """One step of the converter; 0 if bits or range are not known."""
        return 2.0 * self.adc_range_v / 2.0**self.adc_bits if self.adc_bits else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Meta:
    """Everything about a recording that is not a sample; the HDF5 attributes of the root.

    `provenance` holds text: procedure's name, source and parameters (JSON), bench.toml, identities and calibration
    dates of the instruments (JSON), software versions (JSON), operator, start (ISO 8601, UTC), source files and their
    digests of an import (JSON). `simulation` is the model that the lab assumes (`open-recording` key `simulation`), or
    None.

    `extra` keeps data of a foreign recording that benchctl has no name for, so that an export restores them.
    """

    status: Status
    unit: Unit
    bench: BenchFacts
    provenance: Mapping[str, str] = field(default_factory=dict)
    simulation: Mapping[str, Any] | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def output_unit(self) -> str:
        """The unit of the gyro's output, `gyro_v`: volts, but for some imports a rate, `deg/s`."""
        return str(self.extra.get("gyro_output_unit", "V"))


@dataclass(frozen=True, slots=True)
class Step:
    """One step in memory: its description and its channels, name -> array of shape (n,)."""

    info: StepInfo
    channels: Mapping[str, FloatArray]

    def __getitem__(self, channel: str) -> FloatArray:
        """Return the samples of a channel, shape (n,)."""
        return self.channels[channel]
