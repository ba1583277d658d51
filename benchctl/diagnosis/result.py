"""What a diagnosis says, as data: what the JSON, the report and the model file are made of.

Intervals are 95 %. Sizes are in the units of the vocabulary of effects; the rms of `FitFigures` are in volts of the
gyro's output (of the diagnosed quantity, where another part of the bench is diagnosed).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import COORDINATES as COORDINATES

SCHEMA = "benchctl-diagnosis/2"

Part = Literal["gyro", "drive", "chamber"]

Verdict = Literal["consistent", "recalibrate", "missing-physics", "unknown-structure"]

COORDINATE_UNITS: Mapping[str, str] = {
    "time": "s",
    "rate": "°/s",
    "abs_rate": "°/s",
    "rate_sign": "1",
    "acceleration": "°/s²",
    "angle": "°",
    "gyro_temp": "°C",
    "gyro_temp_rate": "°C/s",
    "chamber_temp": "°C",
    "chamber_temp_rate": "°C/s",
    "setpoint": "°C",
    "output": "V",
    "frequency": "Hz",
    "step": "1",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A parameter's value, its interval, its unit; of a parameter of the lab's model `was`, what it was before."""

    value: float
    low: float
    high: float
    unit: str
    was: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Where:
    """Where a mismatch lives: the coordinate, the ranges of it that hold most of it, the steps where it is largest.

    `share_of_excess` is the share of what the noise does not account for that lies in these ranges, 0 to 1.
    """

    coordinate: str
    ranges: tuple[tuple[float, float], ...] = ()
    steps: tuple[str, ...] = ()
    share_of_excess: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Another effect that would do nearly as well, and how probable it is beside the finding."""

    effect: str
    probability: float
    loss: float
    """By how much twice the log likelihood falls if it takes the finding's place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Physics that the data demand. `gain` is the fall of twice the negative log likelihood that it alone brings."""

    effect: str
    probability: float
    parameters: Mapping[str, Estimate]
    where: Where
    explains: float
    gain: float
    gain_heldout: float
    says: str
    alternatives: tuple[Alternative, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class NotFound:
    """An effect that was looked for: the smallest size of it that was found again once added to the recording.

    `parameter` is the one whose size is meant, `others` are the parameters that were held, a time constant say.
    """

    effect: str
    parameter: str
    smallest: float
    unit: str
    others: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureModel:
    """A structure without a name as it was modelled: where it acts, over which coordinate, in which shape.

    `explains` is the share of what was left without it, 0 to 1; `hints` are kinds of causes that act so, no findings.
    """

    identifier: str
    stage: str
    coordinates: tuple[str, ...]
    shape: str
    formula: str
    parameters: Mapping[str, Estimate]
    explains: float
    says: str
    hints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """What no effect accounts for. `share` is its part of the mismatch before anything was explained, 0 to 1.

    `models` are the structures that it was modelled by, the first the largest; empty where none fits.
    """

    significant: bool
    share: float
    coordinates: tuple[str, ...] = ()
    says: str = ""
    models: tuple[StructureModel, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FitFigures:
    """Rms of residuals in `unit`; `heldout_*` on whole steps that chose and fitted nothing, parameters refitted in all.

    `noise` is the recording's own, by no model. `heldout_named` is with the findings, `heldout_after` with everything
    that the model file carries.
    """

    unit: str
    noise: float
    before: float
    after: float
    heldout_before: float
    heldout_named: float
    heldout_after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NextExperiment:
    """The run that best settles what is open. `separation` is the fall of twice the log likelihood to be expected."""

    says: str
    procedure: str = ""
    separates: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    separation: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Slice:
    """The residual over one coordinate: bins (m+1 edges) with their means and standard errors, before and after [V].

    `threshold` is how large |mean|/standard error may be by chance anywhere on the map, one time in a hundred.
    """

    coordinate: str
    edges: FloatArray
    count: FloatArray
    before: FloatArray
    after: FloatArray
    standard_error: FloatArray
    threshold: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StepFigures:
    """Rms [V] of one step's residual: by the model as it came, with its parameters refitted, and with the findings."""

    name: str
    kind: str
    t_start: float
    t_end: float
    heldout: bool
    as_it_came: float
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A short excerpt of a step for the picture, where before and after differ most; arrays of shape (n,).

    `before` and `after` are predictions of `measured`; rows that are `spoilt` played no part in any of them.
    """

    step: str
    heldout: bool
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    spoilt: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """All that a diagnosis found.

    `notes` are honest limits, in sentences: what is not observable in this recording and why. `model` is the content
    of the model file: what `benchctl simulate --model` runs with.
    """

    recording: str
    part: Part
    verdict: Verdict
    says: str
    baseline: Mapping[str, Estimate]
    findings: tuple[Finding, ...]
    unexplained: Unexplained
    fit: FitFigures
    next_experiment: NextExperiment
    not_found: tuple[NotFound, ...]
    slices: tuple[Slice, ...]
    steps: tuple[StepFigures, ...]
    traces: tuple[Trace, ...]
    notes: tuple[str, ...]
    model: Mapping[str, Any]
    threshold: float
    """The gain in twice the log likelihood that chance alone reaches one time in a hundred, anywhere in the search."""
    seed: int

    def as_json(self) -> dict[str, Any]:
        """The contract's JSON (`benchctl-diagnosis/2`), plain data."""
        from benchctl.diagnosis.as_json import as_json

        return as_json(self)
