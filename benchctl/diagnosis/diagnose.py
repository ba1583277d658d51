"""A diagnosis of a recording, from the samples to what it says."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fit import Fit
from benchctl.diagnosis.gyro_problem import GyroProblem, gyro_problem
from benchctl.diagnosis.located import slices_of, step_figures, where_of
from benchctl.diagnosis.result import (
    Alternative,
    Diagnosis,
    Estimate,
    Finding,
    FitFigures,
    NextExperiment,
    NotFound,
    Unexplained,
    Verdict,
)
from benchctl.diagnosis.select import Selection, gain_of, select
from benchctl.recordings.reader import Recording
from instruments.errors import UsageError
from instruments.physics.effects.bias_random_walk import BiasRandomWalk

BoolArray = npt.NDArray[np.bool_]

_Z95 = 1.959964
_MOVED_ERRORS = 5.0
_MOVED_SHARE = 1e-4
"""A parameter has moved beyond five standard errors and beyond 1e-4 of the scale factor or of full scale."""

_POWER_95 = 1.645
_NEAR = 0.001
"""Alternatives less probable beside the finding are not named."""


def diagnose(
    recording: Recording,
    *,
    model: Mapping[str, Any] | None = None,
    part: str = "gyro",
    seed: int = 0,
    without: Collection[str] = (),
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis:
    """What physics the lab's model of a gyro leaves out, as far as the recording demands it.

    `model` takes the place of the simulation that the recording names; hypotheses `without` are not tried. `progress`
    is told the hypothesis that is being tried and the share that is done.

    Raises `UsageError` where the recording names no model, holds too little, or another part than the gyro is asked.
    """
    if part != "gyro":
        raise UsageError(f"--part {part}: only the gyro can be diagnosed as yet; leave --part out")
    problem = gyro_problem(recording, model=model, without=without)
    chosen = select(problem, seed=seed, progress=progress or (lambda _name, _share: None))
    findings = _findings(problem, chosen)
    estimates = _baseline(problem, chosen)
    verdict = _verdict(problem, chosen, findings, estimates)
    open_pairs = tuple(
        name for one in findings for name in (one.effect, *(other.effect for other in one.alternatives[:1]))
    )
    separates = open_pairs if any(one.alternatives for one in findings) else ()
    return Diagnosis(
        recording=recording.path.name,
        verdict=verdict,
        says=_sentence(verdict, findings),
        baseline=estimates,
        findings=findings,
        unexplained=Unexplained(significant=False, share=0.0),
        fit=_figures(problem, chosen),
        next_experiment=NextExperiment(
            says=f"Open is {' or '.join(separates)}." if separates else "Nothing is open between known effects.",
            separates=separates,
        ),
        not_found=_not_found(chosen, {one.effect for one in findings}),
        slices=slices_of(problem, chosen),
        steps=step_figures(problem, chosen),
        traces=(),
        notes=(
            "What no known effect accounts for is not yet tested: the map of the mismatch shows what is left.",
            "Noise that grows with the rate, flicker, outliers, dropouts and coarse conversion are not yet looked for.",
        ),
        model=_model(problem, chosen),
        threshold=chosen.screening.threshold,
        seed=seed,
    )


def _findings(problem: GyroProblem, chosen: Selection) -> tuple[Finding, ...]:
    after, findings = chosen.after, []
    errors = np.sqrt(np.diag(after.covariance))
    whole = gain_of(after, chosen.before)
    for place, effect in enumerate(after.point.effects):
        estimates: dict[str, Estimate] = {}
        for name, parameter in effect.parameters.items():
            value = effect.values[name]
            index = next((i for i, one in enumerate(after.numbers) if one.effect == place and one.name == name), None)
            half = 0.0 if index is None else _Z95 * float(errors[index])
            low, high = value - half, value + half
            if parameter.logarithmic and index is not None:
                low, high = value * math.exp(-half), value * math.exp(half)
            estimates[name] = Estimate(value=value, low=low, high=high, unit=parameter.unit)
        rivals = chosen.rivals.get(effect.identifier, {})
        alternatives = tuple(
            Alternative(effect=name, probability=chance, loss=loss)
            for name, loss in sorted(rivals.items(), key=lambda one: one[1])
            if (chance := 1.0 / (1.0 + math.exp(min(max(loss, 0.0), 1400.0) / 2.0))) > _NEAR
        )
        gain = min(rivals.values(), default=whole) if len(after.point.effects) > 1 else whole
        findings.append(
            Finding(
                effect=effect.identifier,
                probability=1.0 - sum(one.probability for one in alternatives[:1]),
                parameters=estimates,
                where=where_of(problem, chosen, effect.coordinate),
                explains=_explained(chosen),
                gain=max(gain, 0.0),
                gain_heldout=gain_of(after, chosen.before, chosen.heldout),
                says=effect.says(),
                alternatives=alternatives,
            )
        )
    wander = _wander(chosen)
    if wander is not None:
        size = wander.v_per_sqrt_s
        unit = wander.parameters["v_per_sqrt_s"].unit
        spread = math.exp(_Z95 / math.sqrt(max(after.rows * chosen.whitener.walk_gain, 1.0)))
        findings.append(
            Finding(
                effect=wander.identifier,
                probability=0.99,
                parameters={"v_per_sqrt_s": Estimate(value=size, low=size / spread, high=size * spread, unit=unit)},
                where=where_of(problem, chosen, wander.coordinate),
                explains=_explained(chosen),
                gain=chosen.walk_gain_of_likelihood,
                gain_heldout=0.0,
                says=wander.says(),
            )
        )
    return tuple(findings)


def _wander(chosen: Selection) -> BiasRandomWalk | None:
    """The random walk of the bias, where the data demand one."""
    if chosen.walk_gain_of_likelihood == 0.0:
        return None
    return BiasRandomWalk(v_per_sqrt_s=chosen.whitener.walk_per_sqrt_s(chosen.after.deviation))


def _explained(chosen: Selection) -> float:
    before, after = chosen.before.squares, chosen.after.squares
    return min(max(1.0 - after / before, 0.0), 1.0)


def _baseline(problem: GyroProblem, chosen: Selection) -> dict[str, Estimate]:
    errors = _Z95 * np.sqrt(np.diag(chosen.after.covariance))
    return {
        name: Estimate(
            value=float(value), low=float(value - error), high=float(value + error), unit=unit, was=float(was)
        )
        for name, unit, value, error, was in zip(
            problem.baseline_names,
            problem.baseline_units,
            chosen.after.point.baseline,
            errors,
            problem.baseline_start,
            strict=False,
        )
    }


def _verdict(
    problem: GyroProblem, chosen: Selection, findings: tuple[Finding, ...], estimates: Mapping[str, Estimate]
) -> Verdict:
    if findings:
        return "missing-physics"
    coldest, hottest = (float(value) for value in (problem.frame.temp_c.min(), problem.frame.temp_c.max()))
    span = max(abs(coldest - problem.chain.law.T0_c), abs(hottest - problem.chain.law.T0_c))
    for name, one, was in zip(estimates, estimates.values(), problem.baseline_start.tolist(), strict=True):
        change = abs(one.value - was)
        if name == "U0_v":
            share = change / problem.full_scale
        elif name == "K0_v_per_dps":
            share = change / abs(one.value)
        else:
            power = int(name.rsplit("_", 1)[1])
            share = change * (span if name.startswith("k_T") else problem.range_dps) ** power
        if change > _MOVED_ERRORS * (one.high - one.value) / _Z95 and share > _MOVED_SHARE:
            return "recalibrate"
    return "consistent"


def _sentence(verdict: Verdict, findings: tuple[Finding, ...]) -> str:
    if findings:
        return " ".join(one.says for one in findings)
    if verdict == "recalibrate":
        return "No physics is missing; the model's own parameters have moved and want recalibrating."
    return "The model agrees with the recording to within its noise."


def _rms(one: Fit, steps: BoolArray) -> float:
    rows = float(one.products.rows[steps].sum())
    return math.sqrt(float(one.products.squares[steps].sum()) / max(rows, 1.0))


def _figures(problem: GyroProblem, chosen: Selection) -> FitFigures:
    resting = np.array([kind == "static" for kind in problem.step_kinds]) & ~chosen.heldout
    steps = resting if resting.any() else ~chosen.heldout
    return FitFigures(
        noise_v=_rms(chosen.after, steps),
        before_v=_rms(chosen.before, ~chosen.heldout),
        after_v=_rms(chosen.after, ~chosen.heldout),
        heldout_before_v=_rms(chosen.before, chosen.heldout),
        heldout_after_v=_rms(chosen.after, chosen.heldout),
    )


def _not_found(chosen: Selection, found: set[str]) -> tuple[NotFound, ...]:
    """For each other effect, at the place where it shows best, the size that would have passed the threshold."""
    shown: dict[str, NotFound] = {}
    level = math.sqrt(chosen.screening.threshold) + _POWER_95
    for one in chosen.screening.scored:
        kind = one.probe.kind
        if kind.identifier in found or not one.probe.sizes:
            continue
        name = next(name for name, parameter in kind.parameters.items() if parameter.role == "size")
        power = float(one.power[0])
        smallest = one.probe.sizes[0] * level / math.sqrt(power) if power > 0.0 else None
        known = shown.get(kind.identifier)
        if known is not None and (smallest is None or (known.smallest or math.inf) <= smallest):
            continue
        shown[kind.identifier] = NotFound(
            effect=kind.identifier,
            parameter=name,
            smallest=smallest,
            unit=kind.parameters[name].unit,
            others={
                other: value
                for other, value in one.probe.columns[0].values.items()
                if kind.parameters[other].role in ("shape", "choice")
            },
            says="" if smallest is not None else f"Not observable in this recording: it needs {kind.excited_by}.",
        )
    return tuple(shown.values())


def _model(problem: GyroProblem, chosen: Selection) -> dict[str, Any]:
    values, law = chosen.after.point.baseline.tolist(), problem.chain.law
    split = 2 + law.temperature_terms
    limit = problem.simulation.get("output_limit_v")
    simulation = {
        "K0_v_per_dps": values[0],
        "U0_v": values[1],
        "T0_c": law.T0_c,
        "k_T": values[2:split],
        "k_omega": values[split:],
        "noise_v_rms": chosen.whitener.white_deviation(chosen.after.deviation),
        **({} if limit is None else {"output_limit_v": float(limit)}),
    }
    wander = _wander(chosen)
    found = chosen.after.point.effects if wander is None else (*chosen.after.point.effects, wander)
    effects = {effect.identifier: effect.values for effect in found}
    return {"format": "benchctl-model/1", "simulation": simulation, "effects": effects}
