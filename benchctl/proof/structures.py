"""Structures without a name that trials conceal: a stage, a coordinate and a shape, drawn with a size.

Their grammar is wider than that of a diagnosis's search: the search lacks some shapes, and a trial may conceal the sum
of two structures. A drawn structure has the same minimum gain as a named effect, so that it tests the physics and not
the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np

from benchctl.proof.sizes import RAMP_C_PER_S, WARM_C, Values
from benchctl.proof.unit import TrialUnit
from benchctl_instruments.physics.structure_places import StructureStage
from benchctl_instruments.physics.structures import Structure, structure, structure_named

_ANY = (
    *("step", "plateau", "kink", "bump", "wave", "smooth_step", "smooth_plateau", "double_bump", "resonance"),
    *("sawtooth", "root", "growth", "curved", "rectified", "chirp"),
)
_ROUND = ("wave", "bump", "resonance", "rectified")
_WAYS = ("negative", "positive")
_DRAWN: tuple[tuple[float, StructureStage, str, str, tuple[str, ...]], ...] = (
    (16, "scale", "gyro_temp", "", _ANY),
    (6, "scale", "angle", "", _ROUND),
    (6, "scale", "time", "", _ANY),
    (4, "scale", "abs_rate", "", ("step", "kink", "memory")),
    (4, "scale", "gyro_temp", "abs_rate", ("step", "kink", "bump", "smooth_step")),
    (12, "bias", "gyro_temp", "", _ANY),
    (4, "bias", "gyro_temp", "rate_sign", ("step", "kink", "bump", "smooth_step")),
    (4, "bias", "gyro_temp", "", ("hysteresis",)),
    (5, "bias", "gyro_temp_rate", "", _ANY),
    (5, "bias", "angle", "", _ROUND),
    (5, "bias", "rate", "", _ANY),
    (5, "bias", "time", "", _ANY),
    (5, "bias", "setpoint", "", _WAYS),
    (4, "bias", "last_sign", "", _WAYS),
    (4, "bias", "abs_rate", "", ("memory",)),
    (3, "bias", "rate_sign", "", ("memory",)),
    (5, "sampling", "gyro_temp", "", ("kink", "step", "smooth_step")),
    (6, "encoder", "time", "", ("jump",)),
    (3, "noise", "gyro_temp", "", ("kink", "bump")),
    (3, "noise", "time", "", ("step", "plateau")),
)
"""Weight, stage, coordinate, the coordinate to which it is proportional, and the possible shapes."""
_OF_DRIVES: Mapping[str, tuple[str, ...]] = {
    "angle": ("bump", "resonance", "plateau", "smooth_plateau", "double_bump", "rectified"),
    "time": ("step", "plateau", "bump", "wave", "smooth_step", "smooth_plateau", "double_bump", "sawtooth"),
    "rate": ("kink", "bump", "resonance", "smooth_step", "smooth_plateau"),
}
"""Coordinates and shapes of a drive's torque; slow waves over its angle are not among them, since they have a name."""
_OF_CHAMBERS: Mapping[str, tuple[str, ...]] = {
    "time": ("step", "plateau", "bump", "smooth_step", "smooth_plateau", "double_bump", "bursts", "sawtooth"),
    "chamber_temp": ("step", "kink", "bump", "plateau", "smooth_step", "smooth_plateau"),
    "heater": ("step", "kink", "plateau", "smooth_step"),
}
"""Coordinates and shapes of a chamber's heat."""
_IN_PAIRS = 0.15
_LARGEST: Mapping[StructureStage, tuple[float, float]] = {
    "scale": (2e-3, 1e-2),
    "bias": (1e-3, 6e-3),
    "sampling": (1e-3, 5e-3),
    "encoder": (100.0, 500.0),
    "noise": (0.5, 2.0),
    "torque": (0.008, 0.04),
    "heat": (5.0, 25.0),
}
"""Range of the change: share of the scale factor, share of full scale, s, arcsec, share of the noise, N·m, K."""
SHAPE_CLASSES: Mapping[str, str] = {
    "step_below": "step",
    "smooth_step": "step",
    "jump": "step",
    "plateau": "bump",
    "smooth_plateau": "bump",
    "double_bump": "bump",
    "resonance": "bump",
    "kink_below": "kink",
    "bend": "kink",
    "root": "kink",
    "power": "kink",
    "power_below": "kink",
    "growth": "kink",
    "rise": "kink",
    "fall": "kink",
    "parabola": "curve",
    "curved": "curve",
    "cubic": "curve",
    "spline6": "curve",
    "spline12": "curve",
    "spline24": "curve",
    "sawtooth": "wave",
    "rectified": "wave",
    "chirp": "wave",
    "bursts": "wave",
}
"""Shape -> the shape that counts as the same, because it may be the nearest one of a search."""


_TORQUE: StructureStage = "torque"
_HEAT: StructureStage = "heat"
_WIDTHS: Mapping[str, tuple[float, float]] = {
    "smooth_step": (0.02, 0.1),
    "smooth_plateau": (0.08, 0.2),
    "bump": (0.04, 0.12),
    "resonance": (0.04, 0.12),
    "double_bump": (0.04, 0.08),
    "root": (0.5, 0.5),
    "growth": (0.1, 0.3),
    "curved": (0.4, 0.6),
    "sawtooth": (0.25, 0.6),
    "rectified": (0.25, 0.6),
    "chirp": (0.25, 0.5),
}
"""The widths of shapes, as shares of the coordinate's range."""


def drawn_structures(rng: np.random.Generator, *, predicted: bool = False) -> list[str]:
    """Draw the identifier of a structure, or of two that add up; `predicted`: only those that change a prediction."""
    names = [_drawn(rng, predicted)]
    if rng.random() < _IN_PAIRS:
        other = _drawn(rng, predicted)
        if other.partition("_over_")[2] != names[0].partition("_over_")[2]:
            names.append(other)
    return names


def _drawn(rng: np.random.Generator, predicted: bool) -> str:
    rows = [one for one in _DRAWN if not (predicted and one[1] in ("noise", "encoder"))]
    weights = np.array([one[0] for one in rows])
    _, stage, over, times, shapes = rows[int(rng.choice(len(rows), p=weights / weights.sum()))]
    return structure(stage, over, str(rng.choice(shapes)), times=times).identifier


def structure_size(identifier: str, rng: np.random.Generator, unit: TrialUnit) -> Values:
    """Draw the parameters of a structure, by name."""
    kind = structure_named(identifier)
    if kind is None:
        raise ValueError(f"{identifier} is no structure")
    low, wide = _range(kind, unit)
    largest = _largest(kind, rng)
    if kind.acts_on == "bias":
        largest *= unit.full_scale_v
    if kind.acts_on == "noise":
        largest = abs(largest)
    if kind.times == "abs_rate":
        largest /= unit.range_dps
    if kind.shape == "memory" and kind.over != "rate_sign":
        largest /= unit.range_dps
    return _values(kind, rng, low, wide, largest)


def structure_of_part(
    part: Literal["drive", "chamber"], rng: np.random.Generator, ranges: Mapping[str, tuple[float, float]]
) -> tuple[str, Values]:
    """Draw the identifier and the parameters of a torque [N·m], or a heat [K], without a name.

    `ranges` holds, by coordinate, the lowest value and the width of the range that every run covers.
    """
    shapes, stage = (_OF_DRIVES, _TORQUE) if part == "drive" else (_OF_CHAMBERS, _HEAT)
    over = str(rng.choice(list(shapes)))
    kind = structure(stage, over, str(rng.choice(shapes[over])))
    return kind.identifier, _values(kind, rng, *ranges[over], _largest(kind, rng))


def _largest(kind: type[Structure], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(_LARGEST[kind.acts_on])))) * float(rng.choice((-1.0, 1.0)))


def _values(kind: type[Structure], rng: np.random.Generator, low: float, wide: float, largest: float) -> Values:
    """Draw the parameters of a structure with this change, at a place within its coordinate's range."""
    at = low + wide * float(rng.uniform(0.25, 0.75))
    if kind.shape == "step":  # a jump, or a ramp between two values
        width = 2e-3 if rng.random() < 0.7 else float(rng.uniform(0.15, 0.5))
        return {"change": largest, "at": at, "width": width * wide}
    if kind.shape == "bursts":
        period = wide / float(rng.uniform(4.0, 12.0))
        return {"change": largest, "at": low, "period": period, "length": period * float(rng.uniform(0.2, 0.6))}
    if kind.shape == "plateau":
        length = wide * float(rng.uniform(0.15, 0.4))
        return {"change": largest, "at": min(at, low + 0.9 * wide - length), "length": length}
    if kind.shape == "kink":
        return {"above": largest / (0.5 * wide), "at": at}
    if kind.shape in _WIDTHS:
        if kind.shape == "growth":
            at = low + wide
        return {"change": largest, "at": at, "width": wide * float(rng.uniform(*_WIDTHS[kind.shape]))}
    if kind.shape == "jump":
        return {"change": largest, "at": at}
    if kind.shape in _WAYS:
        return {"change": 0.3 * largest}
    if kind.shape == "hysteresis":
        width = 10.0 * float(rng.uniform(0.2, 0.8))
        return {"c1": largest / width, "width": width}
    if kind.shape == "memory":
        return {"c1": largest, "tau": float(rng.uniform(20.0, 150.0))}
    phase = float(rng.uniform(0.0, math.tau))
    # slower waves over the angle have a name
    waves = float(rng.integers(5, 10)) if kind.over == "angle" else float(rng.uniform(1.5, 4.0))
    return {"cosine": largest * math.cos(phase), "sine": largest * math.sin(phase), "period": wide / waves}


def _range(kind: type[Structure], unit: TrialUnit) -> tuple[float, float]:
    """Return the lowest value and the width of the coordinate's range that every run covers."""
    ranges = {
        "gyro_temp": (unit.gyro.T0_c - 0.75 * WARM_C, 1.5 * WARM_C),
        "gyro_temp_rate": (-0.4 * RAMP_C_PER_S, 0.8 * RAMP_C_PER_S),
        "angle": (0.0, 360.0),
        "time": (600.0, 3000.0),
        "rate": (-unit.range_dps, 2.0 * unit.range_dps),
        "abs_rate": (0.0, unit.range_dps),
    }
    return ranges.get(kind.over, (-1.0, 2.0))
