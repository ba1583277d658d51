"""The result of a diagnosis as data, from which the JSON, the report and the model file are made.

Intervals are 95 %. Effect sizes are in the units of the effects' parameters; the rms values in `FitFigures` are in
volts of the gyro's output (for the drive and the chamber: in the unit of the diagnosed quantity).

In JSON, numbers are rounded so that machine-dependent last digits do not appear: an estimate to a thousandth of its
interval, all other numbers to six significant digits. The JSON has no times and no paths: the same recording and the
same seed give the same text.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

import benchctl
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import COORDINATES as COORDINATES

SCHEMA = "benchctl-diagnosis/2"
_DIGITS = 6
_DIGITS_OF_AN_INTERVAL = 3

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
    """A parameter's value, interval and unit. `was` is the previous value of a parameter of the lab's model."""

    value: float
    low: float
    high: float
    unit: str
    was: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Where:
    """Where a mismatch occurs: the coordinate, the ranges that hold most of it, and the steps where it is largest.

    `share_of_excess` is the share, 0 to 1, of the mismatch beyond the noise that lies in these ranges.
    """

    coordinate: str
    ranges: tuple[tuple[float, float], ...] = ()
    steps: tuple[str, ...] = ()
    share_of_excess: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Another effect that explains the data nearly as well, with its probability relative to the finding."""

    effect: str
    probability: float
    loss: float
    """Decrease of twice the log likelihood if this effect replaces the finding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """An effect that the data require. `gain` is the decrease of twice the negative log likelihood it alone brings."""

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
    """An effect that was tested: the smallest size that was detected after it had been added to the recording.

    `parameter` is the parameter that states the size; `others` are parameters held constant, such as a time constant.
    """

    effect: str
    parameter: str
    smallest: float
    unit: str
    others: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A structure's function compared with the data of held-out steps, all in the unit of the quantity it changes.

    In bins of the coordinate at `place` (m,): the residual that the function must explain (`required`) and the residual
    after it (`left`), each with a standard `error`. At `along` (k,) the fitted function with its 95 % band.
    """

    place: FloatArray
    required: FloatArray
    left: FloatArray
    error: FloatArray
    along: FloatArray
    fitted: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureModel:
    """The model of an unnamed structure: where it acts, over which coordinates, and its shape.

    `explains` is the share of the residual without it, 0 to 1; `hints` are possible kinds of causes, not findings.
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
    curve: Curve | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """The part of the mismatch that no effect explains. `share` is relative to the mismatch before any finding, 0 to 1.

    `models` are the structures that model it, the largest first; empty if none fits.
    """

    significant: bool
    share: float
    coordinates: tuple[str, ...] = ()
    says: str = ""
    models: tuple[StructureModel, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FitFigures:
    """Rms of residuals in `unit`, with refitted parameters; `heldout_*` on complete steps held out from the search.

    `noise` is the noise of the recording, independent of any model. `heldout_named` is with the findings,
    `heldout_after` with everything in the model file.
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
    """The run that best decides the open question. `separation` is the expected fall of twice the log likelihood."""

    says: str
    procedure: str = ""
    separates: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    separation: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Slice:
    """Mean residual over one coordinate: bins (m+1 edges) with means and standard errors, before and after [V].

    `threshold` is the value of |mean|/standard error that chance exceeds anywhere on the map once in a hundred cases.
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
    """Rms [V] of one step's residual: with the original model, with its parameters refitted, and with the findings."""

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
    """A short excerpt of a step for the plot, where before and after differ most; arrays of shape (n,).

    `before` and `after` are predictions of `measured`; rows marked `spoilt` were not used for either.
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
    """The complete result of a diagnosis.

    `notes` are limitations, in sentences: what is not observable in this recording and why. `model` is the content of
    the model file, which `benchctl simulate --model` reads.
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
    """The gain in twice the log likelihood that chance exceeds, anywhere in the search, once in a hundred cases."""
    seed: int

    def as_json(self) -> dict[str, Any]:
        """Return the data of the JSON format `benchctl-diagnosis/2` as plain objects; non-finite numbers are None."""
        unexplained, following = self.unexplained, self.next_experiment
        return {
            "schema": SCHEMA,
            "recording": self.recording,
            "software": {"benchctl": benchctl.__version__},
            "part": self.part,
            "verdict": self.verdict,
            "says": self.says,
            "baseline": {"parameters": _estimates(self.baseline)},
            "findings": [_finding(finding) for finding in self.findings],
            "unexplained": {
                "significant": bool(unexplained.significant),
                "share": _rounded(unexplained.share),
                "coordinates": list(unexplained.coordinates),
                "says": unexplained.says,
                **({"model": _model(unexplained.models[0])} if unexplained.models else {}),
                **({"further": [_model(one) for one in unexplained.models[1:]]} if unexplained.models[1:] else {}),
            },
            "fit": {
                "unit": self.fit.unit,
                **{
                    name: _rounded(getattr(self.fit, name))
                    for name in ("noise", "before", "after", "heldout_before", "heldout_named", "heldout_after")
                },
            },
            "next_experiment": {
                "says": following.says,
                "procedure": following.procedure,
                "parameters": _plain(following.parameters),
                "separates": list(following.separates),
                "separation": _rounded(following.separation),
            },
            "not_found": [_not_found(one) for one in self.not_found],
            "steps": [_step(one) for one in self.steps],
            "notes": list(self.notes),
            "threshold": _rounded(self.threshold),
            "seed": int(self.seed),
        }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "effect": finding.effect,
        "probability": _rounded(finding.probability),
        "parameters": _estimates(finding.parameters),
        "where": _where(finding.where),
        "explains": _rounded(finding.explains),
        "gain": _rounded(finding.gain),
        "gain_heldout": _rounded(finding.gain_heldout),
        "says": finding.says,
        "alternatives": [
            {"effect": other.effect, "probability": _rounded(other.probability), "loss": _rounded(other.loss)}
            for other in finding.alternatives
        ],
    }


def _model(one: StructureModel) -> dict[str, Any]:
    return {
        "name": one.identifier,
        "stage": one.stage,
        "coordinates": list(one.coordinates),
        "shape": one.shape,
        "formula": one.formula,
        "parameters": _estimates(one.parameters),
        "explains": _rounded(one.explains),
        "says": one.says,
        "hints": list(one.hints),
    }


def _where(where: Where) -> dict[str, Any]:
    return {
        "coordinate": where.coordinate,
        "ranges": [[_rounded(low), _rounded(high)] for low, high in where.ranges],
        "steps": list(where.steps),
        "share_of_excess": _rounded(where.share_of_excess),
    }


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: _estimate(estimate) for name, estimate in estimates.items()}


def _estimate(estimate: Estimate) -> dict[str, Any]:
    width = estimate.high - estimate.low
    entry = {
        "value": _rounded(estimate.value, width),
        "ci95": [_rounded(estimate.low, width), _rounded(estimate.high, width)],
        "unit": estimate.unit,
    }
    return entry if estimate.was is None else {**entry, "was": _rounded(estimate.was, width)}


def _not_found(one: NotFound) -> dict[str, Any]:
    return {
        "effect": one.effect,
        "parameter": one.parameter,
        "would_show_from": {"value": _rounded(one.smallest), "unit": one.unit},
        "injected": True,
        "others": {name: _rounded(value) for name, value in one.others.items()},
    }


def _step(one: StepFigures) -> dict[str, Any]:
    return {
        "name": one.name,
        "kind": one.kind,
        "t_start": _rounded(one.t_start),
        "t_end": _rounded(one.t_end),
        "heldout": bool(one.heldout),
        "as_it_came": _rounded(one.as_it_came),
        "before": _rounded(one.before),
        "after": _rounded(one.after),
    }


def _plain(value: Any) -> Any:
    """Return a procedure's parameters as plain numbers, strings, booleans, and sequences or mappings of these."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | str) or value is None else _rounded(value)


def _rounded(value: float | None, width: float = 0.0) -> float | None:
    """Return a float to six significant digits, or to three digits of `width` if finer; None if not finite."""
    if value is None or not math.isfinite(value):
        return None
    value = float(value)
    digits = _DIGITS
    if value and math.isfinite(width) and width > 0:
        digits = max(digits, _order(value) - _order(width) + _DIGITS_OF_AN_INTERVAL)
    return float(f"{value:.{min(digits, 15)}g}") + 0.0


def _order(value: float) -> int:
    return math.floor(math.log10(abs(value)))
