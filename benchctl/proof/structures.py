"""Structures without a name that trials conceal: a stage, a coordinate and a shape, drawn with a size.

Their grammar is wider than the one that a diagnosis searches: of some shapes it has none, and a trial may conceal the
sum of two. A drawn structure is worth as much as a named effect, so that it is a question of physics and not of noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from benchctl.proof.sizes import RAMP_C_PER_S, WARM_C, Values
from benchctl.proof.unit import TrialUnit
from benchctl_instruments.physics.structure_places import OVER, StructureStage
from benchctl_instruments.physics.structures import Structure, structure_named

_OVER: Mapping[StructureStage, tuple[str, ...]] = {
    "scale": ("gyro_temp", "gyro_temp", "gyro_temp", "angle", "time", "abs_rate"),
    "bias": ("gyro_temp", "gyro_temp", "gyro_temp_rate", "angle", "rate", "time", "setpoint", "last_sign", "abs_rate"),
    "sampling": ("gyro_temp",),
    "encoder": ("time",),
    "noise": ("gyro_temp", "time"),
}
_STAGES: tuple[tuple[StructureStage, float], ...] = (
    ("scale", 0.35),
    ("bias", 0.45),
    ("sampling", 0.05),
    ("encoder", 0.075),
    ("noise", 0.075),
)
_SHAPES = ("step", "plateau", "kink", "bump", "wave", "smooth_step", "resonance", "sawtooth", "root")
_IN_PAIRS = 0.15
_LARGEST: Mapping[StructureStage, tuple[float, float]] = {
    "scale": (2e-3, 1e-2),
    "bias": (1e-3, 6e-3),
    "sampling": (1e-3, 5e-3),
    "encoder": (100.0, 500.0),
    "noise": (0.5, 2.0),
}
"""What a structure changes: a share of the scale factor, of full scale, s, arcsec, a share of the noise."""
SHAPE_CLASSES: Mapping[str, str] = {
    "step_below": "step",
    "smooth_step": "step",
    "resonance": "bump",
    "kink_below": "kink",
    "bend": "kink",
    "root": "kink",
    "power": "kink",
    "power_below": "kink",
    "sawtooth": "wave",
    "bursts": "wave",
    "jump": "step",
}
"""Shapes that stand for another one, where that is the nearest that a search has."""


def drawn_structures(rng: np.random.Generator) -> list[str]:
    """The identifiers of a structure, or of two that add up."""
    names = [_drawn(rng)]
    if rng.random() < _IN_PAIRS:
        other = _drawn(rng)
        if other.partition("_over_")[2] != names[0].partition("_over_")[2]:
            names.append(other)
    return names


def _drawn(rng: np.random.Generator) -> str:
    stages, chances = zip(*_STAGES, strict=True)
    stage: StructureStage = stages[int(rng.choice(len(stages), p=chances))]
    over = str(rng.choice(_OVER[stage]))
    shapes: tuple[str, ...] = _SHAPES
    if over == "angle":
        shapes = ("wave", "bump", "resonance")
    elif OVER[over].ways is not None:
        shapes = ("negative", "positive")
    elif stage == "encoder":
        shapes = ("jump",)
    elif stage == "noise":
        shapes = ("kink", "bump") if over == "gyro_temp" else ("step", "plateau")
    elif stage == "sampling":
        shapes = ("kink", "step", "smooth_step")
    elif over == "abs_rate":
        shapes = ("step", "kink") if stage == "scale" else ("memory",)
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
    if kind.acts_on == "noise":
        largest = abs(largest)
    at = low + wide * float(rng.uniform(0.25, 0.75))
    if kind.shape in ("step", "smooth_step"):
        width = 2e-3 if kind.shape == "step" else float(rng.uniform(0.02, 0.1))
        return {"change": largest, "at": at, "width": wide * width}
    if kind.shape == "plateau":
        length = wide * float(rng.uniform(0.15, 0.4))
        return {"change": largest, "at": min(at, low + 0.9 * wide - length), "length": length}
    if kind.shape == "kink":
        return {"above": largest / (0.5 * wide), "at": at}
    if kind.shape == "root":
        return {"change": largest, "at": at, "width": 0.5 * wide}
    if kind.shape in ("bump", "resonance"):
        return {"change": largest, "at": at, "width": wide * float(rng.uniform(0.04, 0.12))}
    if kind.shape == "jump":
        return {"change": largest, "at": at}
    if kind.shape in ("negative", "positive"):
        return {"change": 0.3 * largest}
    if kind.shape == "memory":
        return {"c1": largest / unit.range_dps, "tau": float(rng.uniform(20.0, 150.0))}
    phase = float(rng.uniform(0.0, math.tau))
    # slower waves over the angle have a name
    whole = float(rng.integers(5, 10)) if kind.over == "angle" else float(rng.uniform(1.5, 4.0))
    if kind.shape == "sawtooth":
        return {"change": largest, "period": wide / whole}
    return {"cosine": largest * math.cos(phase), "sine": largest * math.sin(phase), "period": wide / whole}


def _range(kind: type[Structure], unit: TrialUnit) -> tuple[float, float]:
    """The lowest value of a coordinate that every run reaches, and how far it goes on from there."""
    ranges = {
        "gyro_temp": (unit.gyro.T0_c - 0.75 * WARM_C, 1.5 * WARM_C),
        "gyro_temp_rate": (-0.4 * RAMP_C_PER_S, 0.8 * RAMP_C_PER_S),
        "angle": (0.0, 360.0),
        "time": (600.0, 3000.0),
        "rate": (-unit.range_dps, 2.0 * unit.range_dps),
        "abs_rate": (0.0, unit.range_dps),
        "setpoint": (-1.0, 2.0),
        "last_sign": (-1.0, 2.0),
    }
    return ranges[kind.over]
