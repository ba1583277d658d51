"""Draw an effect for a real recording and add it; motion, noise and time stamps of the recording stay unchanged.

An effect is drawn from the vocabulary of the recording's part, except those that the untouched recording already shows
and those that one run cannot distinguish from them. Its size is drawn relative to the residual of the untouched
recording's diagnosis: it is the rms of that part of the effect that no change of the fitted parameters absorbs. If the
residual wanders, as a chamber's air does, both are measured as innovations, because slow wander hides slow effects. An
effect that this recording cannot distinguish from another single effect, fitted in its place, is not drawn: no
diagnosis could name it.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.gyro.stacked import stacked
from benchctl.diagnosis.parts import problem_of
from benchctl.diagnosis.result import Part
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.closest import distance, nothing_known
from benchctl.estimation.disturbance import disturbance_of
from benchctl.estimation.noise import Whitener
from benchctl.estimation.point import Point
from benchctl.proof.draw import alike, rounded
from benchctl.recordings.model import Step, axis_of
from benchctl.recordings.reader import Recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.effect import DescribedEffect, PhysicalEffect
from benchctl_instruments.physics.structures import structure_named

FAIR = (0.5, 2.0)
"""Range of a fair size: rms relative to the residual of the untouched diagnosis, drawn uniformly in the logarithm."""

_CHANNELS: Mapping[Part, tuple[str, ...]] = {
    "gyro": ("gyro_v", "point_mean_v"),
    "drive": ("torque_nm", "drive_load"),
    "chamber": ("chamber_temp_c", "poll_chamber_temp_c"),
}
"""The channel that an effect of a part changes: the first of these that a step has."""
_TRIES, _ROUNDS = 60, 5
"""Number of effects drawn for a trial, and of repetitions if the recording distinguishes none of them from others."""
_RANGE = 1e8
_NUDGE = 1e-4
_LEFT_OVER = 0.5
"""If another effect leaves less than this share of an effect's rms, the recording does not distinguish the two."""
_LIKE = 0.2
"""Share of an effect's power that another one must absorb at the start of its search; otherwise it is not fitted."""
_SINGULAR = 1e-12
"""Share of the largest singular value below which a direction is only rounding error of another one."""
_MILD = 0.5
"""Share of the largest output by which an effect may change a sample; a change of 100 % would be obvious."""
_STATED = 0.05
"""Minimum probability of an alternative that counts as stated."""
_DIGITS = 12
_ROUNDING, _OF_A_STEP = 1e-9, 0.02
"""Rounding error as a share of the values; permitted deviation from a multiple of a converter's step, in steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Injection:
    """What trial `index` adds; `share` is its rms relative to the residual of the untouched recording."""

    index: int
    effect: str
    parameters: Mapping[str, float]
    share: float
    nonce: str

    def digest(self) -> str:
        """Return the SHA-256 of the injection as JSON."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()


class Untouched:
    """A recording without an added effect, and its blind diagnosis, given as JSON data."""

    def __init__(self, recording: Recording, answer: Mapping[str, Any]) -> None:
        self._recording, self._answer = recording, answer
        self._part: Part = answer["part"]

    @property
    def found(self) -> tuple[frozenset[str], ...]:
        """The effects that the recording itself shows: per finding its name and its stated alternatives."""
        return tuple(stated_of(one) for one in self._answer["findings"])

    @cached_property
    def _problem(self) -> PartProblem:
        return problem_of(self._recording, self._part)

    @cached_property
    def _baseline(self) -> FloatArray:
        stated = self._answer["baseline"]["parameters"]
        return np.array([stated[name]["value"] for name in self._problem.baseline_names], dtype=np.float64)

    @cached_property
    def _own(self) -> tuple[DescribedEffect, ...]:
        """The effects and structures of the untouched recording's model; the noises that it names are not in it."""
        named = ((one["effect"], one) for one in self._answer["findings"] if one["effect"] in self._problem.effects)
        unnamed = ((one["name"], one) for one in self._unnamed)
        return tuple(
            self._made(name, {key: value["value"] for key, value in one["parameters"].items()})
            for name, one in (*named, *unnamed)
        )

    @property
    def _unnamed(self) -> Sequence[Mapping[str, Any]]:
        """The structures of the untouched recording's model, as JSON data."""
        unexplained = self._answer["unexplained"]
        return [unexplained["model"], *unexplained.get("further", ())] if "model" in unexplained else []

    @cached_property
    def _kinds(self) -> Mapping[str, type[DescribedEffect]]:
        """The effects of the part, and the structures of the untouched recording's model."""
        structures = {one["name"]: structure_named(one["name"]) for one in self._unnamed}
        return {**self._problem.effects, **{name: kind for name, kind in structures.items() if kind is not None}}

    def drawn(self, seed: int, index: int) -> Injection:
        """Draw an injection, reproducible for a given seed and index.

        Raises `UsageError` if the recording reveals no other effect.
        """
        rng = np.random.default_rng([seed, index])
        nonce = np.random.default_rng([seed, index, 1]).bytes(16).hex()
        found = frozenset[str]().union(*self.found)
        names = [one for one in self._problem.effects if not alike(one, found)]
        for name in self._lots(rng, names):
            wanted = math.exp(rng.uniform(math.log(FAIR[0]), math.log(FAIR[1])))
            values = self._of_size(name, _shaped(self._problem.effects[name], rng), wanted * self._left)
            if values is None:
                continue
            one = self._made(name, values)
            share = rounded(self._shown(one) / self._left)  # a limit may coincide with a rate of the recording, or not
            if FAIR[0] <= share <= FAIR[1] and self._is_mild(one) and self._stands_apart(one):
                return Injection(index=index, effect=name, parameters=values, share=share, nonce=nonce)
        raise UsageError(
            f"{self._recording.path}: none of {', '.join(names) or 'the effects'} shows in this recording as much as"
            " what its diagnosis leaves, and unlike any other; take one with more motion, or of a wider range of"
            " temperatures"
        )

    @staticmethod
    def _lots(rng: np.random.Generator, names: Sequence[str]) -> Iterator[str]:
        for _ in range(_ROUNDS if names else 0):
            yield from rng.permutation([*names] * _TRIES)[:_TRIES].tolist()

    def with_it(self, injection: Injection) -> Iterator[Step]:
        """Yield the steps of the recording with the injection added."""
        problem = self._in_every_row
        change = self._change(problem, self._made(injection.effect, injection.parameters))
        for step in self._recording.steps():
            name = next((one for one in _CHANNELS[self._part] if one in step.channels), None)
            if name is None:
                yield step
                continue
            added = np.interp(step[axis_of(name)], problem.time_s, change)
            yield Step(step.info, {**step.channels, name: _in_steps_of(step[name], step[name] + added)})

    @cached_property
    def _in_every_row(self) -> PartProblem:
        """The problem in the rows of the recording, regardless of which rows a diagnosis compares."""
        problem = self._problem
        if not isinstance(problem, GyroProblem):
            return problem
        return replace(problem, band=None, usable=np.ones(problem.frame.rows, np.bool_))

    def _is_mild(self, one: DescribedEffect) -> bool:
        """Return whether an effect changes no sample of a gyro by more than half of the largest output.

        Its size is measured in the slow part of the motion; in a shaking motion it may be far larger.
        """
        problem = self._in_every_row
        if not isinstance(problem, GyroProblem):
            return True
        most = _MILD * float(np.nanmax(np.abs(problem.frame.volts)))
        return bool(np.nanmax(np.abs(self._change(problem, one))) <= most)

    def _made(self, name: str, values: Mapping[str, float]) -> DescribedEffect:
        return self._kinds[name].make(values, self._problem.circumstances)

    def _change(self, problem: PartProblem, one: DescribedEffect) -> FloatArray:
        """Return the effect's change of the measured quantity, shape (n,); a converter's effects act on the samples."""
        if isinstance(problem, GyroProblem) and isinstance(one, PhysicalEffect) and _acts_on_samples(one):
            stack, signals = stacked(problem.frame)
            samples = slice(None) if stack.samples is None else stack.samples
            output_v = np.zeros(signals.time_s.size)
            output_v[samples] = problem.frame.volts
            return problem.slow(one.apply(replace(signals, output_v=output_v)).output_v[samples] - problem.frame.volts)
        here = self._predicted if problem is self._problem else problem.predict(self._baseline, self._own)
        return problem.predict(self._baseline, (*self._own, one)) - here

    def _of_size(self, name: str, shaped: dict[str, float], rms: float) -> dict[str, float] | None:
        """Return the parameters with which an effect has this rms; None if that is impossible within its bounds."""
        kind = self._problem.effects[name]
        strong = _strength(kind)

        def scaled(factor: float) -> dict[str, float]:
            zeros = {one: kind.parameters[one].zero for one in strong}
            grown = {one: shaped[one] * factor if zeros[one] == 0.0 else shaped[one] / factor for one in strong}
            return {**shaped, **grown}

        def excess(log_factor: float) -> float:
            shown = self._shown(self._made(name, scaled(math.exp(log_factor))))
            return math.log(max(shown, 1e-300) / rms)

        factors = np.geomspace(1.0 / _RANGE, _RANGE, 129).tolist()
        inside = [factor for factor in factors if self._possible(name, scaled(factor))]
        if not strong or not inside:
            return None
        low, high = math.log(inside[0]), math.log(inside[-1])
        if not excess(low) < 0.0 < excess(high):
            return None
        factor = math.exp(brentq(excess, low, high, xtol=0.01))
        return {one: rounded(value) for one, value in scaled(factor).items()}

    def _possible(self, name: str, values: Mapping[str, float]) -> bool:
        parameters = self._problem.effects[name].parameters
        within = all(one.low <= values[key] <= one.high for key, one in parameters.items())
        return within and self._made(name, values).plausible

    def _shown(self, one: DescribedEffect) -> float:
        """Return the rms of an effect's change that no change of the fitted parameters absorbs."""
        rows = self._problem.usable
        change = self._change(self._problem, one)
        if not np.isfinite(change[rows]).all():
            return 0.0
        left = self._unexplained(self._whitened(change)[rows])
        return math.sqrt(float(left @ left) / max(left.size, 1))

    def _stands_apart(self, one: DescribedEffect) -> bool:
        """Return whether no fit without an effect absorbs most of its change, alone or with another single effect.

        The fitted parameters alone can absorb more than to first order: an offset of a pendulum is also another angle
        at which it hangs.
        """
        problem, rows = self._problem, self._problem.usable
        target = self._predicted + self._change(problem, one)
        added = self._unexplained(self._whitened(target - self._predicted)[rows])
        there = {one.identifier, *(own.identifier for own in self._own)}
        least = _LEFT_OVER**2 * float(added @ added) / self._left**2

        def whiten(values: FloatArray) -> FloatArray:
            return np.where(rows, self._whitened(values) / self._left, 0.0)

        others = (self._likest(kind, added) for kind in problem.effects.values() if kind.identifier not in there)
        for instead in ((), *((rival,) for rival in others if rival is not None)):
            point = Point(baseline=self._baseline, effects=(*self._own, *instead))
            free = nothing_known(point, tuple(point.free(problem.baseline_names, problem.baseline_bounds)))
            if distance(target, free, problem.predict, whiten) < least:
                return False
        return True

    def _likest(self, kind: type[DescribedEffect], added: FloatArray) -> DescribedEffect | None:
        """Return the start of a search for an effect that is most similar to `added`, shape (n,); None if none is.

        `added` is whitened and has no part that the fitted parameters absorb.
        """
        rows = self._problem.usable
        best, most = None, _LIKE * float(added @ added)
        for probe in probes_of(self._problem, kind):
            predicted = [self._problem.predict(self._baseline, (*self._own, one)) for one in probe.columns]
            if not np.isfinite(predicted).all():
                continue
            changes = [self._whitened(one - self._predicted)[rows] for one in predicted]
            columns = np.stack([self._unexplained(one) for one in changes], axis=1)
            weights = np.linalg.lstsq(columns, added, rcond=None)[0]
            explained = float(added @ added) - float(np.sum((added - columns @ weights) ** 2))
            if explained > most:
                best, most = probe.start(np.asarray(weights, np.float64)), explained
        return best

    def _unexplained(self, added: FloatArray) -> FloatArray:
        """Remove from whitened values of the usable rows, shape (n,), what changes of the fitted parameters absorb."""
        own = self._directions
        return np.asarray(added - own @ (own.T @ added))

    @cached_property
    def _directions(self) -> FloatArray:
        """Orthonormal columns (n, p) of the changes that the fitted parameters absorb, in the usable rows."""
        left, sizes, _ = np.linalg.svd(self._absorbing[self._problem.usable], full_matrices=False)
        return np.asarray(left[:, sizes > _SINGULAR * sizes.max()])

    @cached_property
    def _left(self) -> float:
        """Rms of the residual of the untouched recording's diagnosis; of its innovations if it wanders."""
        if not self._problem.disturbed:
            return float(self._answer["fit"]["after"])
        left = self._whitened(self._residual)[self._problem.usable]
        return math.sqrt(float(left @ left) / max(left.size, 1))

    @cached_property
    def _residual(self) -> FloatArray:
        return self._problem.measured - self._predicted

    @cached_property
    def _predicted(self) -> FloatArray:
        """The prediction of the untouched recording's model, shape (n,)."""
        return self._problem.predict(self._baseline, self._own)

    @cached_property
    def _whitened(self) -> Callable[[FloatArray], FloatArray]:
        """Filter that whitens the residual, shape (n,), of a disturbed quantity; identity for any other quantity."""
        if not self._problem.disturbed:
            return lambda values: values
        every = self._problem.usable
        slow = disturbance_of(self._problem, self._residual, self._baseline, self._own).slow
        weight = every.astype(np.float64)
        return Whitener(interval_s=self._problem.interval_s, weight=weight, time_s=self._problem.time_s).with_slow(slow)

    @cached_property
    def _absorbing(self) -> FloatArray:
        """Derivatives of the prediction by all fitted parameters, each of unit rms, shape (n, p)."""
        columns = []
        for place, value in enumerate(self._baseline.tolist()):
            moved = self._baseline.copy()
            moved[place] += _NUDGE * (abs(value) or 1.0)
            columns.append(self._problem.predict(moved, self._own) - self._predicted)
        for place, one in enumerate(self._own):
            for name, parameter in one.parameters.items():
                if parameter.role in ("choice", "assumed"):
                    continue
                value = one.values[name]
                own = list(self._own)
                own[place] = self._made(one.identifier, {**one.values, name: value + _NUDGE * (value or 1.0)})
                columns.append(self._problem.predict(self._baseline, own) - self._predicted)
        table = np.stack([self._whitened(column) for column in columns], axis=1)
        return np.asarray(table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300))


def stated_of(finding: Mapping[str, Any]) -> frozenset[str]:
    """Return the effect that a finding, given as JSON data, names, and the alternatives that it states."""
    others = (one["effect"] for one in finding["alternatives"] if one["probability"] >= _STATED)
    return frozenset((finding["effect"], *others))


def _in_steps_of(measured: FloatArray, changed: FloatArray) -> FloatArray:
    """Round changed values to the steps of the converter that measured them, if steps are visible; shape (n,) each."""
    moved = np.abs(np.diff(measured))
    moved = moved[moved > _ROUNDING * np.abs(measured).max()]
    steps = moved / moved.min() if moved.size else moved
    if not moved.size or np.abs(steps - np.round(steps)).max() > _OF_A_STEP:
        digits = _DIGITS - math.ceil(math.log10(max(float(np.abs(changed).max()), 1e-300)))
        return np.round(changed, digits)  # a sample at a rail must have exactly its value
    step = float(moved.min())
    return np.asarray(measured[0] + np.round((changed - measured[0]) / step) * step)


def _acts_on_samples(one: PhysicalEffect) -> bool:
    return one.pointwise and one.stage in ("electronics", "sampling")


def _strength(kind: type[DescribedEffect]) -> Sequence[str]:
    """Return the parameters that make an effect vanish: its sizes, or else a time constant, a cutoff or a limit."""
    able = {name: one for name, one in kind.parameters.items() if one.zero in (0.0, math.inf) and one.role != "choice"}
    sizes = [name for name, one in able.items() if one.role == "size"]
    return sizes or list(able)[:1]


def _shaped(kind: type[DescribedEffect], rng: np.random.Generator) -> dict[str, float]:
    """Draw parameters of a plausible shape; sizes keep the values with which a search begins."""
    values = {}
    for name, one in kind.parameters.items():
        low, high = min(one.scan), max(one.scan)
        if one.role == "phase":
            values[name] = rounded(rng.uniform(0.0, 360.0))
        elif one.role == "choice":
            values[name] = float(rng.choice(one.scan))
        elif one.role == "size":
            values[name] = one.scan[0] * (float(rng.choice((-1.0, 1.0))) if one.low < 0.0 else 1.0)
        elif one.logarithmic:
            values[name] = rounded(math.exp(rng.uniform(math.log(low), math.log(high))))
        else:
            values[name] = rounded(rng.uniform(low, high))
    return values
