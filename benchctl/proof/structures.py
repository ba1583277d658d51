"""Structures without a name that trials conceal: a stage, a coordinate and a shape, drawn with a size.

Their grammar is that of `benchctl_instruments.physics.structures`. A drawn structure is worth as much as a named
effect, so that it is a question of physics and not of noise.
"""

from __future__ import annotations

import math

import numpy as np

from benchctl.proof.sizes import RAMP_C_PER_S, WARM_C, Values
from benchctl.proof.unit import TrialUnit
from benchctl_instruments.physics.structures import Structure, structure_named

_OVER = {
    "scale": ("gyro_temp", "gyro_temp", "angle", "time"),
    "bias": ("gyro_temp", "gyro_temp", "gyro_temp_rate", "angle", "rate"),
}
_SHAPES = ("step", "plateau", "kink", "bump", "wave")
_LARGEST = {"scale": (2e-3, 1e-2), "bias": (1e-3, 6e-3)}
"""What a structure changes: a share of the scale factor, or of full scale."""


def drawn_structure(rng: np.random.Generator) -> str:
    """The identifier of a structure."""
    stage = str(rng.choice(list(_OVER)))
    over = str(rng.choice(_OVER[stage]))
    shapes = ("wave", "bump") if over == "angle" else _SHAPES
    return f"{rng.choice(shapes)}_of_{stage}_over_{over}"


def structure_size(identifier: str, rng: np.random.Generator, unit: TrialUnit) -> Values:
    """The parameters of a structure, by name."""
    kind = structure_named(identifier)
    if kind is None:
        raise ValueError(f"{identifier} is no structure")
    low, wide = _range(kind, unit)
    largest = float(np.exp(rng.uniform(*np.log(_LARGEST[kind.acts_on])))) * float(rng.choice((-1.0, 1.0)))
    if kind.acts_on == "bias":
        largest *= unit.full_scale_v
    at = low + wide * float(rng.uniform(0.25, 0.75))
    if kind.shape == "step":
        return {"change": largest, "at": at, "width": wide * 2e-3}
    if kind.shape == "plateau":
        length = wide * float(rng.uniform(0.15, 0.4))
        return {"change": largest, "at": min(at, low + 0.9 * wide - length), "length": length}
    if kind.shape == "kink":
        return {"above": largest / (0.5 * wide), "at": at}
    if kind.shape == "bump":
        return {"change": largest, "at": at, "width": wide * float(rng.uniform(0.04, 0.12))}
    phase = float(rng.uniform(0.0, math.tau))
    # slower waves over the angle have a name
    whole = float(rng.integers(5, 10)) if kind.over == "angle" else float(rng.uniform(1.5, 4.0))
    return {"cosine": largest * math.cos(phase), "sine": largest * math.sin(phase), "period": wide / whole}


def _range(kind: type[Structure], unit: TrialUnit) -> tuple[float, float]:
    """The lowest value of a coordinate that every run reaches, and how far it goes on from there."""
    ranges = {
        "gyro_temp": (unit.gyro.T0_c - 0.75 * WARM_C, 1.5 * WARM_C),
        "gyro_temp_rate": (-0.4 * RAMP_C_PER_S, 0.8 * RAMP_C_PER_S),
        "angle": (0.0, 360.0),
        "time": (600.0, 3000.0),
        "rate": (-unit.range_dps, 2.0 * unit.range_dps),
    }
    return ranges[kind.over]
