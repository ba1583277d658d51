"""Held samples: dropouts, and an output that is recorded faster than it changes."""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.standing import Output, Runs, evidence_of
from benchctl.diagnosis.result import Estimate
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.effects.dropouts import Dropouts

_FEWEST_VALUES, _REGULAR = 30, 0.9
"""Minimum number of values in motion, and the share of them that must last alike."""

_PRETENDED = 300
"""Number of places at which a hold is simulated to estimate the detectable share."""

_OFTEN, _ONE_SIDE = 0.7, 0.025
"""Maximum probability that an adjacent value equals the held one by chance; error probability on one side."""

_ALIKE = 2
"""Length differences, in rows, of holds of one duration: the value before the hold may also occur just after it."""


def holds_in(output: Output, runs: Runs, railed: BoolArray, interval_s: float) -> Fault | None:
    """Return the dropouts, from constant `runs` that are not at a rail; None if there are none.

    `railed` (n,) rows are at a rail, where a hold is not detectable.
    """
    rows = np.zeros(output.volts.size, np.bool_)
    for first, stop in zip(runs.first.tolist(), runs.stop.tolist(), strict=True):
        rows[first + 1 : stop] = True
    if not rows.any():
        return None
    lengths = (runs.stop - runs.first).astype(np.float64)
    length, shorter, longer = _length(lengths, output)
    share = _share_seen(output, ~railed & output.alive, max(3, round(length)))
    count = lengths.size / share
    spread = Z95 * math.sqrt(lengths.size * (1.0 - share)) / share
    hold_s = (length - 0.5) * interval_s
    effect = Dropouts(count=float(round(count)), hold_s=hold_s)
    units = {name: parameter.unit for name, parameter in effect.parameters.items()}
    return Fault(
        effect=effect.identifier,
        parameters={
            "count": Estimate(
                value=effect.count,
                low=float(max(lengths.size, math.floor(count - spread))),
                high=float(math.ceil(count + spread - 1e-9)),
                unit=units["count"],
            ),
            "hold_s": Estimate(
                value=hold_s,
                low=max(hold_s - shorter * interval_s, 0.0),
                high=hold_s + longer * interval_s,
                unit=units["hold_s"],
            ),
        },
        rows=rows,
        gain=bounded_gain(float(runs.evidence.sum())),
        says=effect.says(),
    )


def rows_per_value(output: Output) -> int:
    """Return the number of rows with which each value is repeated while the output should move; 1 if it is new in each.

    A recorder that is faster than a digital gyro repeats the gyro's last value until the next one arrives.
    """
    should_move = np.abs(np.diff(output.predicted)) >= output.step_v
    should_move &= output.alive[1:] & output.alive[:-1] & output.foretold[1:]
    should_move[[part.start - 1 for part in output.stretches[1:]]] = False
    changes = np.flatnonzero(np.diff(output.volts) != 0.0)
    moved = np.concatenate([[0], np.cumsum(should_move)])
    lengths = np.diff(changes)[np.diff(moved[changes + 1]) == np.diff(changes)]
    if lengths.size < _FEWEST_VALUES:
        return 1
    usual = round(float(np.median(lengths)))
    return usual if float(np.mean(np.abs(lengths - usual) <= 1)) > _REGULAR else 1


def repeats_in(output: Output, rows: int) -> BoolArray:
    """Return a mask, shape (n,), of the rows that repeat a value of so many rows; at rest each such row is new too."""
    new = np.concatenate([[True], np.diff(output.volts) != 0.0])
    new[[part.start for part in output.stretches]] = True
    index = np.arange(new.size)
    since = index - np.maximum.accumulate(np.where(new, index, 0))
    return np.asarray(since % rows != 0)


def _length(lengths: FloatArray, output: Output) -> tuple[float, float, float]:
    """Return the usual number of equal rows of a hold, and by how many rows it may be shorter or longer.

    A value repeated N times was held for N − 1 to N intervals, so half an interval is uncertain, and another half from
    the way an instrument counts. If most holds have one length, the shorter ones define it: a longer one met an equal
    value by chance. With few holds, all of them may have done so.
    """
    values, counts = np.unique(lengths, return_counts=True)
    together = np.array([counts[(values >= value) & (values < value + _ALIKE)].sum() for value in values])
    most = int(np.argmax(together))
    if 2 * together[most] > lengths.size:
        meets = min(output.step_v / (math.sqrt(math.pi) * max(output.noise_v, 1e-300)), _OFTEN)
        met = math.floor(math.log(_ONE_SIDE) / (float(together[most]) * math.log(meets)))
        return float(values[most]), 1.0 + met, 1.0
    spread = 1.0 + Z95 * float(np.std(lengths, ddof=1)) * math.sqrt(math.pi / (2.0 * lengths.size))
    return float(np.median(lengths)), spread, spread


def _share_seen(output: Output, visible: BoolArray, length: int) -> float:
    """Return the share of holds of this many rows, at any time, distinguishable from an output at rest."""
    places = np.linspace(0, output.volts.size - length - 1, _PRETENDED).astype(np.int64)
    detected = [
        bool(visible[place : place + length].all()) and evidence_of(output, place, place + length) > output.enough
        for place in places.tolist()
    ]
    return max(float(np.mean(detected)), 1.0 / _PRETENDED)
