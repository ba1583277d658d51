"""A plan as rows that a gyro's problem can predict: motion and temperatures before the plan is run.

A step is represented by a few excerpts spread over it, sampled only as fast as the plan's fastest motion requires. Each
row represents a number of the digitizer's samples, so that the rows together represent the complete step.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl.bench import Bench
from benchctl.campaign.timing import timeline
from benchctl.diagnosis.gyro.frame import Frame
from benchctl.plan import ConstantRate, Plan, Sine, Soak, Step, ThermalRamp
from benchctl.plan.steps import ByHand, positions
from benchctl.recordings.model import StepInfo
from benchctl.signals.motion import motions_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chamber import ChamberParameters, ChamberState, advance, settled, switched

_EXCERPT_S = 2.0
_PERIODS = 3.0
_APART_S = 60.0
_MOST_EXCERPTS = 10
_EDGE_S, _EDGE_ROWS = 0.25, 10
"""Length of the ends of an excerpt that do not count, because a filter lacks the previous values there."""
_SAMPLES_A_PERIOD = 10.0
_OF_SLOW_MOTION, _SLOW_HZ = 24.0, 4.0
_LEAST_HZ = 20.0
_THINNED = (1, 2, 3, 5, 7, 11, 13, 17, 23, 31, 43, 59)
"""Factors of sample reduction: primes, so that a line at a divisor of the sample rate is not aliased to zero."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    """The rows of a plan. `stands_for` (n,) is the number of samples that a row represents, 0 if it does not count."""

    frame: Frame
    stands_for: FloatArray
    bench_time_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Excerpt:
    """A number of rows of a step, the first at `start_s` of the plan and `into_s` of the step's stream."""

    place: int
    step: Step
    start_s: float
    into_s: float
    rows: int
    stands_for: float
    from_c: float
    to_c: float
    air_c: float


def planned(plan: Plan, bench: Bench, auxiliary: Sequence[str] = ()) -> Planned:
    """Return the rows of a plan on a bench that starts at its safe set point; `auxiliary` channels are constant.

    Lags of chamber and gyro are those of the simulated bench, as those of a real one are not known beforehand.
    """
    rate_hz = bench.digitizer.sample_rate_hz
    fastest_hz = max(_frequency_hz(step) or 0.0 for step in plan.steps)
    enough_hz = max(_LEAST_HZ, _OF_SLOW_MOTION * min(fastest_hz, _SLOW_HZ), _SAMPLES_A_PERIOD * fastest_hz)
    thinned = max(one for one in _THINNED if one == 1 or rate_hz / one >= enough_hz)
    interval_s = thinned / rate_hz
    times = list(timeline(plan, bench.limits, bench.safe.chamber_c))
    excerpts = list(_excerpts(plan.steps, times, bench, interval_s))
    return Planned(
        frame=_frame(plan, excerpts, interval_s, auxiliary),
        stands_for=np.concatenate([_counting(one, interval_s) for one in excerpts]),
        bench_time_s=times[-1][1],
    )


def _frequency_hz(step: Step) -> float | None:
    if isinstance(step, Sine):
        return step.frequency_hz
    return step.swing_hz if isinstance(step, ThermalRamp) and step.swing_dps else None


def _excerpts(
    steps: Sequence[Step], times: Sequence[tuple[float, float, float]], bench: Bench, interval_s: float
) -> Iterator[_Excerpt]:
    """Yield the excerpts of every streamed step, with a continuous climate; none while a unit is not along."""
    climate = _Climate(bench)
    for place, (step, (start_s, end_s, _), position) in enumerate(zip(steps, times, positions(steps), strict=True)):
        if isinstance(step, Soak):
            climate.set(start_s, step.setpoint_c, bench.limits.ramp_c_per_min)
            continue
        if isinstance(step, ByHand):
            continue
        stream_s = end_s - step.streamed_s
        if isinstance(step, ThermalRamp):
            climate.set(stream_s, step.to_c, step.ramp_c_per_min)
        if position != "along":
            continue
        hz = _frequency_hz(step)
        length_s = min(step.streamed_s, max(_EXCERPT_S, _PERIODS / hz if hz else 0.0))
        count = min(2 + int(step.streamed_s / _APART_S), _MOST_EXCERPTS, int(step.streamed_s / length_s))
        length_s = step.streamed_s if count == 1 else length_s
        rows = max(2, round(length_s / interval_s))
        edge = _edge(rows, interval_s)
        for i in range(count):
            into_s = (i + 0.5) * step.streamed_s / count - 0.5 * length_s
            from_c, air_c = climate.at(stream_s + into_s)
            yield _Excerpt(
                place=place,
                step=step,
                start_s=stream_s + into_s,
                into_s=into_s,
                rows=rows,
                stands_for=step.streamed_s * bench.digitizer.sample_rate_hz / (count * (rows - 2 * edge)),
                from_c=from_c,
                to_c=climate.at(stream_s + into_s + length_s)[0],
                air_c=air_c,
            )


class _Climate:
    """Air and thermistor temperature over the time of a plan; calls must be in order of time."""

    def __init__(self, bench: Bench) -> None:
        self._parameters = ChamberParameters(ramp_c_per_min=bench.limits.ramp_c_per_min)
        self._room_c = bench.safe.chamber_c
        self._state: ChamberState = switched(settled(self._parameters, self._room_c), True)
        self._now_s = 0.0

    def set(self, now_s: float, setpoint_c: float, ramp_c_per_min: float) -> None:
        self.at(now_s)
        self._parameters = replace(self._parameters, ramp_c_per_min=ramp_c_per_min)
        self._state = replace(self._state, setpoint_c=setpoint_c)

    def at(self, now_s: float) -> tuple[float, float]:
        """Return the temperatures of thermistor and air [°C]."""
        self._state = advance(self._parameters, self._room_c, self._state, max(now_s - self._now_s, 0.0))
        self._now_s = max(now_s, self._now_s)
        return self._state.housing_c, self._state.air_c


def _edge(rows: int, interval_s: float) -> int:
    """Return how many rows at either end do not count."""
    return min(max(round(_EDGE_S / interval_s), _EDGE_ROWS), (rows - 1) // 3)


def _counting(excerpt: _Excerpt, interval_s: float) -> FloatArray:
    stands_for = np.full(excerpt.rows, excerpt.stands_for)
    edge = _edge(excerpt.rows, interval_s)
    if edge:
        stands_for[:edge] = stands_for[-edge:] = 0.0
    return stands_for


def _frame(plan: Plan, excerpts: Sequence[_Excerpt], interval_s: float, auxiliary: Sequence[str]) -> Frame:
    bounds = np.cumsum([0, *(one.rows for one in excerpts)]).tolist()
    stretches = tuple(slice(low, high) for low, high in itertools.pairwise(bounds))
    moving = [_motion(one, interval_s) for one in excerpts]
    angle, rate, acceleration = (np.concatenate([one[i] for one in moving]) for i in range(3))
    time_s = np.concatenate([one.start_s + interval_s * np.arange(one.rows) for one in excerpts])
    temp = np.concatenate([np.linspace(one.from_c, one.to_c, one.rows) for one in excerpts])
    slopes = [np.full(one.rows, (one.to_c - one.from_c) / (one.rows * interval_s)) for one in excerpts]
    motions = motions_of([one[0] for one in moving], 1.0 / interval_s)
    return Frame(
        infos=tuple(_info(place, step) for place, step in enumerate(plan.steps)),
        interval_s=interval_s,
        time_s=time_s,
        step=np.repeat([one.place for one in excerpts], [one.rows for one in excerpts]),
        stretches=stretches,
        origins_s=(0.0,) * len(stretches),
        motions=motions,
        encoder_deg=angle,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=acceleration,
        sudden=np.zeros_like(angle),
        volts=np.zeros_like(angle),
        temp_c=temp,
        temp_rate_c_per_s=np.concatenate(slopes),
        chamber_c=np.repeat([one.air_c for one in excerpts], [one.rows for one in excerpts]),
        auxiliary={name: np.zeros_like(angle) for name in auxiliary},
    )


def _motion(excerpt: _Excerpt, interval_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the commanded angle, rate and acceleration of the table, shape (n,) each.

    A swing starts at its turning point, so that it continues smoothly into the past that filters assume.
    """
    t = interval_s * np.arange(excerpt.rows, dtype=np.float64)
    match excerpt.step:
        case Sine(amplitude_dps=peak, frequency_hz=hz):
            return _swing(peak, hz, t)
        case ThermalRamp(swing_dps=peak, swing_hz=hz) if peak:
            return _swing(peak, hz, t)
        case ConstantRate(rate_dps=rate) | ThermalRamp(rate_dps=rate):
            return rate * (excerpt.into_s + t), np.full_like(t, rate), np.zeros_like(t)
        case _:
            return np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)


def _swing(peak_dps: float, hz: float, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    omega = 2.0 * math.pi * hz
    return (
        -peak_dps / omega * np.cos(omega * t),
        peak_dps * np.sin(omega * t),
        peak_dps * omega * np.cos(omega * t),
    )


def _info(place: int, step: Step) -> StepInfo:
    return StepInfo(index=place + 1, name=step.label, kind=step.kind, t_start=0.0, t_end=0.0, chamber_setpoint_c=0.0)
