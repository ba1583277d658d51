"""Dropouts: the output is held for a while, then goes on."""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.faults.standing import Output, Runs, evidence_of
from benchctl.diagnosis.result import Estimate
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.effects.dropouts import Dropouts

_PRETENDED = 300
"""Places at which a hold is pretended, to learn how many of them would be seen."""

_OFTEN, _ONE_SIDE = 0.7, 0.025
"""How often, at most, a held value is met again before or after by chance; what is left to chance on one side."""

_ALIKE = 2
"""Rows by which the lengths of holds of one duration differ: the value before the hold may come once more after it."""


def holds_in(output: Output, runs: Runs, railed: BoolArray, interval_s: float) -> Fault | None:
    """The dropouts that standing `runs` away from the rail are; None where there are none.

    `railed` (n,) rows stand at a rail: nobody sees a hold there.
    """
    rows = np.zeros(output.volts.size, np.bool_)
    for first, stop in zip(runs.first.tolist(), runs.stop.tolist(), strict=True):
        rows[first + 1 : stop] = True
    if not rows.any():
        return None
    lengths = (runs.stop - runs.first).astype(np.float64)
    length, shorter, longer = _length(lengths, output)
    seen = _share_seen(output, ~railed & output.alive, max(3, round(length)))
    count = lengths.size / seen
    spread = Z95 * math.sqrt(lengths.size * (1.0 - seen)) / seen
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


def _length(lengths: FloatArray, output: Output) -> tuple[float, float, float]:
    """The usual number of equal rows of a hold, and by how many it may be shorter or longer.

    A value that is put out N times stood for N − 1 to N intervals, so half of one is uncertain, and as much again by
    how an instrument counts. Where most holds are of one length, the shorter of them tell it: a longer one has met an
    equal value by chance. All of them may have, where they are few.
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
    """The share of holds of this many rows, at any time, that would have been told from an output at rest."""
    places = np.linspace(0, output.volts.size - length - 1, _PRETENDED).astype(np.int64)
    seen = [
        bool(visible[place : place + length].all()) and evidence_of(output, place, place + length) > output.enough
        for place in places.tolist()
    ]
    return max(float(np.mean(seen)), 1.0 / _PRETENDED)
