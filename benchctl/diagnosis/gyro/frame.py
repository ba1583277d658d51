"""A gyro's recording as a frame for a diagnosis: one row per sample, with every signal that the model uses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchctl.diagnosis.gyro.subsample import AIR, FILLED, NEEDED, THERMISTOR, Subsample, subsample_of
from benchctl.diagnosis.series import channels_of
from benchctl.recordings.model import Step, StepInfo, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import TOLERANCE, gap_free
from benchctl.signals.motion import Motion, table_motions
from benchctl.signals.rate import unwrap_deg
from benchctl.signals.setpoint import way_of_setpoint
from benchctl.signals.temperature import Pause, Readings, Thermistor, thermistor_of
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.structure_places import CHAMBER_C, LEAST_TURNING_DPS, SETPOINT_WAY

_FEWEST_ROWS = 2000
_LEAST_AIR_C = 1.0
"""Minimum change of the chamber's air; smaller changes are noise and control, and contain no information."""

_STEADY, _STEADY_S = 0.05, 0.5
"""Maximum relative change of a steady rate, and its duration; a table that stops from it does not turn back."""
_SAME_ANGLE_DEG = 0.01

_UNEVEN, _MOST_UNEVEN = 0.1, 0.01
"""Maximum deviation of a time stamp as a share of the interval, and maximum share of stamps that exceed it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """All samples of a recording in order; arrays of shape (n,).

    `step` is the index of a row's step in `infos`; `stretches` are the parts without gaps, `motions` their motions;
    `origins_s` are the start times of the joined recordings that the stretches belong to. `time_s` starts at the first
    recording. `temp_c` is the gyro's thermistor, smoothed; `thermistor` names the channel used, if the gyro has none.
    `pauses` are the thermistor readings before a stretch, if known. `filled` rows were not measured; `left_out` is the
    number of rows omitted from a very long recording. If the motion goes `beyond` the band of the filters, the wide
    filter was used for all of it. The motion of a noisy encoder is low-passed beyond `known_hz`; `noisy_within` if
    its noise counts below that frequency, too.
    """

    infos: tuple[StepInfo, ...]
    interval_s: float
    time_s: FloatArray
    step: IntArray
    stretches: tuple[slice, ...]
    origins_s: tuple[float, ...]
    motions: tuple[Motion, ...]
    encoder_deg: FloatArray
    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    sudden: FloatArray
    volts: FloatArray
    temp_c: FloatArray
    temp_rate_c_per_s: FloatArray
    chamber_c: FloatArray
    auxiliary: dict[str, FloatArray]
    thermistor: str = THERMISTOR
    pauses: tuple[Pause | None, ...] = ()
    filled: BoolArray | None = None
    beyond: bool = False
    left_out: int = 0
    known_hz: float | None = None
    noisy_within: bool = False

    @property
    def reach(self) -> int:
        """Number of rows on either side that contribute to the motion of a row."""
        return max(one.size for one in self.motions[0].filters) // 2

    @property
    def rows(self) -> int:
        """The number of samples."""
        return int(self.time_s.size)


def turned_unseen(frame: Frame) -> BoolArray:
    """Return a mask, shape (n,), of rows at rest before which the table turned in an unknown direction.

    Motion between stretches is not recorded. A table that turned steadily just before stopped without turning back; one
    that was at rest at the same angle did not turn. Otherwise the direction is unknown until the table turns again.
    """
    unseen = np.zeros(frame.rows, np.bool_)
    last = max(round(_STEADY_S / frame.interval_s), 1)
    known, before, origin_s = False, slice(0, 0), math.nan
    for part, part_origin_s in zip(frame.stretches, frame.origins_s, strict=True):
        turning = np.abs(frame.rate_dps[part]) > LEAST_TURNING_DPS
        if part_origin_s != origin_s:
            known = False
        else:
            ended_dps = frame.rate_dps[max(before.stop - last, before.start) : before.stop]
            turned_deg = math.remainder(float(frame.angle_deg[part.start] - frame.angle_deg[before.stop - 1]), 360.0)
            steady = np.ptp(ended_dps) <= _STEADY * np.abs(ended_dps).max()
            at_rest = np.abs(ended_dps).max() <= LEAST_TURNING_DPS
            known = (known and abs(turned_deg) <= _SAME_ANGLE_DEG) if at_rest else bool(steady)
        if not known:
            unseen[part] = ~np.logical_or.accumulate(turning)
        known = known or bool(turning.any())
        before, origin_s = part, part_origin_s
    return unseen


def frame_of(recording: Recording, *, temperature_c: float | None = None, most: int | None = None) -> Frame:
    """Read a recording into a frame; `temperature_c` is used if neither gyro nor chamber has a thermometer.

    From a recording with more rows than `most`, so many rows are sampled.

    Raises `UsageError` if it has too few scans of encoder and gyro, or if they are not usable.
    """
    taken = subsample_of(recording, most)
    steps = taken.steps
    if not steps:
        raise UsageError(
            f"{recording.path}: a diagnosis needs steps with the channels {', '.join(NEEDED)} in one scan;"
            f" it has {channels_of(recording)}."
            " An encoder's rate becomes its angle where a map imports it as encoder_deg"
        )
    columns = {name: np.concatenate([step[name] for step in steps]) for name in NEEDED}
    time_s = columns["time_s"]
    if time_s.size < _FEWEST_ROWS:
        raise UsageError(
            f"{recording.path}: {time_s.size} samples with motion and output are too few to tell physics from noise;"
            f" a diagnosis needs {_FEWEST_ROWS} or more"
        )
    _require_finite(recording, steps)
    interval_s = float(np.median(np.diff(time_s)))
    _require_even(recording, time_s, interval_s)
    stretches = tuple(gap_free(time_s, interval_s))
    origins_s = tuple(max(one for one in (0.0, *recording.starts_s) if one <= time_s[part.start]) for part in stretches)
    unwrapped = [unwrap_deg(columns["encoder_deg"][part]) for part in stretches]
    made, beyond = table_motions(unwrapped, 1.0 / interval_s)
    motion, motions = _end_to_end(made, stretches)
    name, thermistors = _thermistors(recording, taken, sorted(set(origins_s)), temperature_c)
    temperatures = [thermistors[at].at(time_s[part]) for at, part in zip(origins_s, stretches, strict=True)]
    air_c = np.concatenate([_air(step) for step in steps])
    extras = set.intersection(*(set(step.channels) for step in steps)) - {*NEEDED, THERMISTOR, AIR, FILLED}
    return Frame(
        infos=tuple(step.info for step in steps),
        interval_s=interval_s,
        time_s=time_s,
        step=np.repeat(np.arange(len(steps)), [step["time_s"].size for step in steps]),
        stretches=stretches,
        origins_s=origins_s,
        motions=motions,
        encoder_deg=np.concatenate(unwrapped),
        **motion,
        volts=columns["gyro_v"],
        temp_c=np.concatenate([temp for temp, _ in temperatures]),
        temp_rate_c_per_s=np.concatenate([rate for _, rate in temperatures]),
        chamber_c=air_c,
        auxiliary={
            **{
                name: np.concatenate([step[name] for step in steps])
                for name in sorted(extras)
                if axis_of(name) == "time_s"
            },
            **_climate([step.info for step in steps], time_s, air_c),
        },
        thermistor=name,
        pauses=tuple(_pauses(time_s, stretches, origins_s, thermistors)),
        filled=np.concatenate([step.channels.get(FILLED, np.zeros(step["time_s"].size)) > 0.0 for step in steps]),
        beyond=beyond,
        left_out=taken.left_out,
        known_hz=None,
        noisy_within=False,
    )


def _end_to_end(
    motions: Sequence[Motion], stretches: Sequence[slice]
) -> tuple[dict[str, FloatArray], tuple[Motion, ...]]:
    """Concatenate the motions of all stretches, by name, and return each motion as views of these arrays."""
    names = ("angle_deg", "rate_dps", "acceleration_dps2", "sudden")
    series = {name: np.concatenate([getattr(motion, name) for motion in motions]) for name in names}

    def part(motion: Motion, rows: slice) -> Motion:
        own: dict[str, Any] = {name: values[rows] for name, values in series.items()}
        return replace(motion, **own)

    return series, tuple(map(part, motions, stretches))


def _require_finite(recording: Recording, steps: Sequence[Step]) -> None:
    for step in steps:
        for name in ("encoder_deg", THERMISTOR):
            values = step.channels.get(name)
            if values is not None and not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0])
                raise UsageError(
                    f"{recording.path}: step {step.info.index} ({step.info.name}): {name} is {values[row]} at sample"
                    f" {row}; a motion or a temperature that is not known cannot be diagnosed: import it without"
                )


def _require_even(recording: Recording, time_s: FloatArray, interval_s: float) -> None:
    """Raise `UsageError` if the time stamps are not those of a single clock."""
    apart = np.diff(time_s)
    inside = apart[apart <= (1.0 + TOLERANCE) * interval_s]  # with two rates, the faster one counts as uneven
    uneven = float(np.mean(np.abs(inside - interval_s) > _UNEVEN * interval_s)) if interval_s > 0.0 else 1.0
    if uneven > _MOST_UNEVEN:
        raise UsageError(
            f"{recording.path}: {100.0 * uneven:.0f} % of the stamps are not {interval_s * 1e3:.4g} ms after the one"
            ' before: a diagnosis needs samples of one clock; import with stamps = "repair", or steps of one rate alone'
        )


def _thermistors(
    recording: Recording, taken: Subsample, origins_s: Sequence[float], temperature_c: float | None
) -> tuple[str, Mapping[float, Thermistor]]:
    """Return the channel of the gyro's temperature, and the temperature by start time of the joined recordings."""
    name = taken.thermometer
    if not name and temperature_c is None:
        raise UsageError(
            f"{recording.path}: no step has the gyro's thermistor ({THERMISTOR}); it has {channels_of(recording)}; "
            "an import names it in its map"
        )
    measured: dict[float, list[Readings]] = {at: [] for at in origins_s}

    def add(one: Readings) -> None:
        if one.time_s.size:
            measured[max(at for at in origins_s if at <= one.time_s[0] or at == origins_s[0])].append(one)

    for step in taken.steps:
        add(Readings(step["time_s"], step[name] if name else np.full(step["time_s"].size, temperature_c)))
    for unseen in taken.unseen:
        add(unseen)
    polled = f"poll_{THERMISTOR}"
    for info in recording.infos if name == THERMISTOR else ():
        if not info.is_left_out and polled in recording.channels(info.index):
            soak = recording.step(info.index, ("poll_time_s", polled))
            add(Readings(soak["poll_time_s"], soak[polled]))
    return name, {at: thermistor_of(those) for at, those in measured.items()}


def _pauses(
    time_s: FloatArray,
    stretches: Sequence[slice],
    origins_s: Sequence[float],
    thermistors: Mapping[float, Thermistor],
) -> Iterator[Pause | None]:
    """Yield the known temperatures before each stretch, since the previous stretch or the first poll; else None."""
    for i, (part, at) in enumerate(zip(stretches, origins_s, strict=True)):
        begins = i == 0 or origins_s[i - 1] != at
        since_s = thermistors[at].begin_s if begins else float(time_s[stretches[i - 1].stop - 1])
        yield thermistors[at].pause(since_s, float(time_s[part.start]))


def _climate(infos: Sequence[StepInfo], time_s: FloatArray, air_c: FloatArray) -> dict[str, FloatArray]:
    """Return the chamber's air without noise, and the sign of its set point's change, at the rows, if known."""
    known = np.isfinite(air_c)
    if not known.any() or float(np.ptp(air_c[known])) < _LEAST_AIR_C:
        return {}
    smooth, _ = thermistor_of([Readings(time_s[known], air_c[known])]).at(time_s)
    way = way_of_setpoint(infos, time_s, air_c)
    return {CHAMBER_C: smooth} | ({} if way is None else {SETPOINT_WAY: way})


def _air(step: Step) -> FloatArray:
    """Return the chamber's air at the scans, interpolated from polls if no scan has it; NaN if neither exists."""
    if AIR in step.channels:
        return step[AIR]
    polled, times = step.channels.get(f"poll_{AIR}"), step.channels.get("poll_time_s")
    if polled is None or times is None or not times.size:
        return np.full(step["time_s"].size, np.nan)
    return np.interp(step["time_s"], times, polled)
