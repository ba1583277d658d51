"""The output of the unit under test as one channel with a unit: a digital gyro's frames in the form of scans.

All analyses read `time_s`, `encoder_deg`, `gyro_v`, `gyro_temp_c`, and the unit of `gyro_v` from `Meta.output_unit`. If
a recording has frames, the digital gyro is the unit under test, and `under_test` presents them in this form:

| channel       | of frames                                                                                        |
|---------------|--------------------------------------------------------------------------------------------------|
| `time_s`      | `frame_time_s`; a missing frame is a gap in it                                                   |
| `encoder_deg` | the encoder's angle at the frames' instants, a cubic spline through the scans between two gaps   |
| `gyro_v`      | `frame_rate_dps`; NaN if the gyro states an invalid sample                                       |
| `gyro_temp_c` | `frame_temp_c`                                                                                   |
| `rate_x_dps`  | `frame_rate_x_dps` of a unit of three axes; `rate_y_dps` and `rate_z_dps` likewise               |

`poll_gyro_temp_c` of a soak is its `poll_frame_temp_c`, the temperature that the gyro stated then.

`Meta.output_unit` is then `deg/s`, as for an imported recording of rates: in results K0 is the stated rate over the
true rate, a number near 1, and U0 a rate, although their names end in `_v_per_dps` and `_v`. The angle is moved to the
frames and not the frames to the scans, because a spline through noise is no longer the gyro's noise.

What the analogue inputs read in addition (`gyro_v`, the thermistor, their polls in a soak) is left out, and so are
frames before the first scan and after the last. A frame is stamped when it has arrived: its transit is part of the
delay that a fit states. The gyro's clock counts as that of its nominal rate; a diagnosis finds another (`clock_drift`).
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchctl.recordings.model import AXIS_CHANNELS, FRAME_CHANNELS, Axis, Meta, Step, StepInfo, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import gap_free
from benchctl.recordings.stored import StoredStep
from benchctl.signals.rate import unwrap_deg
from benchctl_instruments.arrays import FloatArray

_TIME: Axis = "frame_time_s"
_RATE, _CELSIUS, _STATUS = FRAME_CHANNELS[1:]
AXIS_RATES = ("rate_x_dps", "rate_y_dps", "rate_z_dps")
"""The outputs of a unit of three axes."""
_AXES = dict(zip(AXIS_RATES, AXIS_CHANNELS, strict=True))
_AS_SCANS: Mapping[str, str] = {"time_s": _TIME, "gyro_v": _RATE, "gyro_temp_c": _CELSIUS, **_AXES}
_ANGLE = "encoder_deg"
_THERMISTOR, _CELSIUS_POLLED = "poll_gyro_temp_c", "poll_frame_temp_c"
_OF_ANALOGUE = (_THERMISTOR, "poll_gyro_v")
_REACH = 24
"""Scans on either side that a spline is influenced by: beyond, by less than 1e-13."""
_FEWEST = 4
_OF_RATE = 5.0
"""Maximum factor between 1 and the K0 of a model that is already one of the rate."""


def under_test(recording: Recording) -> Recording:
    """Return the recording with a digital gyro's frames as its output; unchanged if it has none.

    A step without frames, as that of an analogue gyro in a joined recording, then has no output.
    """
    source = _Frames(recording)
    if not source.rows:
        return recording
    infos = [source.described(info) for info in recording.infos]
    return Recording(
        recording.path,
        _of_rate(recording.meta),
        infos,
        source,
        digest=recording.digest,
        notes=recording.notes,
        starts_s=recording.starts_s,
    )


def angles_at(instants_s: FloatArray, time_s: FloatArray, angle_deg: FloatArray) -> FloatArray:
    """Return angles in [0, 360) at instants (n,), from scans (m,) of finite stamps; NaN where there are no scans."""
    found = np.full(instants_s.size, np.nan)
    known = np.isfinite(angle_deg)
    time_s, angle_deg = time_s[known], angle_deg[known]
    if time_s.size < _FEWEST:
        return found
    for run in gap_free(time_s, float(np.median(np.diff(time_s)))):
        if run.stop - run.start < _FEWEST:
            continue
        begin_s, end_s = time_s[run.start], time_s[run.stop - 1]
        inside = (begin_s <= instants_s) & (instants_s <= end_s)
        found[inside] = CubicSpline(time_s[run], unwrap_deg(angle_deg[run]))(instants_s[inside])
    wrapped: FloatArray = np.mod(found, 360.0)
    return wrapped


class _Frames:
    """A `StepSource` of steps whose output is a digital gyro's.

    `rows` are the first frame that is between two scans and the one after the last, of each step that has frames.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._lock = threading.Lock()  # several channels are made of the same ones
        needed = {"time_s", _ANGLE, *FRAME_CHANNELS}
        having = [info.index for info in recording.infos if needed <= set(recording.channels(info.index))]
        self.rows = {index: _between_scans(recording.stored_step(index)) for index in having}

    def described(self, info: StepInfo) -> StepInfo:
        """Return the description of a step in which frames are the samples."""
        first, last = self.rows.get(info.index, (0, 0))
        return replace(info, samples=last - first, sample_rate_hz=info.frame_rate_hz)

    def channels(self, index: int) -> tuple[str, ...]:
        """See `StepSource`."""
        there = self._recording.channels(index)
        axes = [name for name, recorded in _AXES.items() if recorded in there]
        scans = ("time_s", _ANGLE, "gyro_v", "gyro_temp_c", *axes) if index in self.rows else ()
        polls = [name for name in there if axis_of(name) == "poll_time_s" and name not in _OF_ANALOGUE]
        return (*scans, *(_THERMISTOR if name == _CELSIUS_POLLED else name for name in polls))

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        """See `StepSource`; without frames at an unknown angle."""
        stored = self.stored(info)
        wanted = stored.names if names is None else [name for name in stored.names if name in names]
        polls = {name: stored.read(name, 0, stored.polls) for name in wanted if axis_of(name) == "poll_time_s"}
        if info.index not in self.rows:
            return Step(info, polls)
        rows = stored.part(0, stored.scans, {*wanted, _ANGLE})
        known = np.isfinite(rows[_ANGLE])
        return Step(
            info, {**{name: values[known] for name, values in rows.channels.items() if name in wanted}, **polls}
        )

    def stored(self, info: StepInfo) -> StoredStep:
        """See `StepSource`; the angle is NaN where it is not known."""
        step = self._recording.stored_step(info.index)
        first, last = self.rows.get(info.index, (0, 0))

        def fill(name: str, start: int, samples: FloatArray) -> None:
            with self._lock:
                if name == _ANGLE:
                    samples[:] = _angles(step, step.read(_TIME, first + start, first + start + samples.size))
                elif name == _THERMISTOR:
                    step.fill(_CELSIUS_POLLED, start, samples)
                elif name not in _AS_SCANS:
                    step.fill(name, start, samples)
                else:
                    step.fill(_AS_SCANS[name], first + start, samples)
                if name == "gyro_v":
                    samples[step.read(_STATUS, first + start, first + start + samples.size) != 0.0] = np.nan

        return replace(step, info=info, names=self.channels(info.index), scans=last - first, fill=fill)

    def close(self) -> None:
        """Close the recording; safe to call twice."""
        self._recording.close()


def _between_scans(step: StoredStep) -> tuple[int, int]:
    if not step.scans:
        return 0, 0
    begin_s, end_s = (float(step.read("time_s", scan, scan + 1)[0]) for scan in (0, step.scans - 1))
    return _place(step, _TIME, step.frames, begin_s), _place(step, _TIME, step.frames, end_s)


def _angles(step: StoredStep, instants_s: FloatArray) -> FloatArray:
    """Return the angles at some frames of a step, from the scans around them."""
    if not instants_s.size:
        return instants_s
    first = max(_place(step, "time_s", step.scans, float(instants_s[0])) - _REACH, 0)
    last = min(_place(step, "time_s", step.scans, float(instants_s[-1])) + _REACH, step.scans)
    return angles_at(instants_s, step.read("time_s", first, last), step.read(_ANGLE, first, last))


def _place(step: StoredStep, axis: Axis, samples: int, instant_s: float) -> int:
    """Return the first sample of an axis that is not before an instant."""
    return bisect_left(range(samples), instant_s, key=lambda row: float(step.read(axis, row, row + 1)[0]))


def _of_rate(meta: Meta) -> Meta:
    """Return the description of a recording whose output is a rate; a converter of volts has no part in it."""
    return replace(
        meta,
        bench=replace(meta.bench, adc_bits=0, adc_range_v=0.0),
        simulation=None if meta.simulation is None else _model_of_rate(meta.simulation),
        extra={**meta.extra, "gyro_output_unit": "deg/s"},
    )


def _model_of_rate(simulation: Mapping[str, Any]) -> dict[str, Any]:
    """Return a model in volts as that of a gyro that states (U − U0)/K0; one that is already of the rate unchanged."""
    scale = abs(float(simulation["K0_v_per_dps"]))
    if 1.0 / _OF_RATE <= scale <= _OF_RATE:
        return dict(simulation)
    volts = {name: simulation[name] / scale for name in ("noise_v_rms", "output_limit_v") if name in simulation}
    return {**simulation, **volts, "K0_v_per_dps": 1.0, "U0_v": 0.0}
