"""Dead zone: rates about zero over which the output changes by less than half of what the scale factor asks for.

By a slow swing through zero: its samples are gathered in narrow bins of rate, and the slope between neighbouring bins
is held against the scale factor.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.metrology.drift import white_variance
from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import Observations, celsius_of, column, dots, refused
from benchctl.metrology.propagation import Offsets, Quantity, as_read, propagated, single
from benchctl.metrology.result import Measured, message
from benchctl.metrology.swings import Swing, fitted
from benchctl.recordings.model import StepInfo
from benchctl_instruments.arrays import FloatArray

_NAME = "dead_zone"
_WIDEST_DPS, _FASTEST_HZ = 2.0, 0.1
_BINS = 25
_USED = 0.95
"""Share of the amplitude that is used: near its ends a sine adds no information."""
_HALF = 0.5
_DEG_PER_H = 3600.0


def dead_zone_tests(obs: Observations) -> Iterator[Measured]:
    """The one result."""
    info = _slow_swing(obs)
    if info is None or info.frequency_hz is None:
        yield refused(_NAME, message("needs_slow_swing"))
        return
    step = obs.recording.step(info.index, ("time_s", "encoder_deg", "gyro_v"))
    swing = fitted(step, info.frequency_hz)
    edges = _USED * (0.0 if swing is None else abs(swing.rate_phasor)) * np.linspace(-1.0, 1.0, _BINS + 1)
    if swing is None or not np.histogram(swing.rate_dps, edges)[0].all():
        yield refused(_NAME, message("needs_slow_swing"))
        return
    output_v, standard_v = _binned(swing, edges)
    middle, width_dps = 0.5 * (edges[1:] + edges[:-1]), float(edges[1] - edges[0])
    slope = obs.scale_v_per_dps

    def slopes(offsets: Offsets) -> FloatArray:
        return np.asarray(np.diff(output_v + offsets["scatter"], axis=1) / (slope * width_dps))

    def zone(offsets: Offsets) -> FloatArray:
        return _DEG_PER_H * (width_dps * _longest_run(slopes(offsets) < _HALF) + offsets["bins"][:, 0])

    quantities: list[Quantity] = [
        Quantity(name="scatter", root=np.diag(standard_v), kind="A", note="scatter of the samples in a bin"),
        single("bins", width_dps / np.sqrt(6.0), "width of the bins, at both ends"),
    ]
    response = as_read(slopes, quantities)
    seen_one = bool((response < _HALF).any())
    between = 0.5 * (middle[1:] + middle[:-1])
    table = column("rate", "deg/h", _DEG_PER_H * between), column("response", "1", response)
    yield Measured(
        name=_NAME,
        unit=UNITS[_NAME],
        value=float(as_read(zone, quantities)) if seen_one else _DEG_PER_H * width_dps,
        uncertainty=propagated(zone, quantities),
        bound="" if seen_one else "at most",
        temperature_c=celsius_of(info.chamber_setpoint_c),
        steps=(info.index,),
        table=table,
        picture=dots(*table),
    )


def _slow_swing(obs: Observations) -> StepInfo | None:
    if obs.reference is None:
        return None
    for info in obs.recording.infos:
        slow = info.frequency_hz is not None and info.frequency_hz <= _FASTEST_HZ
        small = (info.amplitude_dps or np.inf) <= _WIDEST_DPS
        if info.kind == "sine" and info.whole and slow and small and not info.mounting:
            return info
    return None


def _binned(swing: Swing, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean output in each bin, moved to its middle, and its standard uncertainty; (bins,) each."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    place = np.digitize(swing.rate_dps, edges) - 1
    inside = (place >= 0) & (place < middle.size)
    place, rate_dps, output_v = place[inside], swing.rate_dps[inside], swing.output_v[inside]
    slope = float(np.polyfit(rate_dps, output_v, 1)[0])
    count = np.bincount(place, minlength=middle.size)
    off_dps = np.bincount(place, rate_dps, middle.size) / count - middle
    # inside a zone the output does not follow the rate: there the bins are crowded evenly, and nothing is moved
    means = np.bincount(place, output_v, middle.size) / count - slope * off_dps
    white_v = float(np.sqrt(white_variance(swing.output_v)))
    return means, white_v / np.sqrt(count)


def _longest_run(flags: np.ndarray) -> FloatArray:
    """The length of the longest run of true flags in each row of (d, n)."""
    longest, current = np.zeros(flags.shape[0]), np.zeros(flags.shape[0])
    for column_of in flags.T:
        current = np.where(column_of, current + 1.0, 0.0)
        longest = np.maximum(longest, current)
    return longest
