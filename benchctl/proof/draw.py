"""Draw what the trials of a proof conceal: random, but reproducible for a given seed."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.optimize import brentq

from benchctl.plan import Plan
from benchctl.plan.find import find_procedure
from benchctl.proof.classes import CLASSES, FAINT_GAIN, ClassName, TrialClass
from benchctl.proof.planned import Planned, planned
from benchctl.proof.sizes import DRAWN, STATISTICAL, WANDERING, Values, drawn_size, shrunk
from benchctl.proof.structures import drawn_structures, structure_size
from benchctl.proof.truth import Truth
from benchctl.proof.unit import TrialUnit, draw_unit
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.registry import effect
from benchctl_instruments.physics.structures import structure_named

PROCEDURE = "diagnostic"

LEAST_GAIN = 1000.0
"""Minimum gain of a concealed effect, except a faint one; a smaller one would test the noise and not the physics.

In the presence of a wandering bias the minimum is `FAINT_GAIN`.
"""

_TRIES = 60
_LEAST_SHARE = 1e-7

_ALIKE = (
    frozenset({"timing_offset", "sensor_bandwidth", "angular_acceleration", "mount_resonance", "clock_drift"}),
    frozenset({"warm_up", "bias_drift", *WANDERING}),
    frozenset({"scale_warm_up", "scale_ageing"}),
    frozenset({"saturation", "two_rails", "overload", "fringe_ambiguity", "rate_nonlinearity"}),
    frozenset({"thermal_lag", "thermal_hysteresis"}),
    frozenset({"adc_coarse", "adc_nonlinearity"}),
)
"""No trial conceals two effects of the same group: a single run cannot distinguish them."""

_DELAYS = frozenset({"sensor_bandwidth", "mount_resonance"})
"""At a quarter of their size or less they act so far above the motion's frequencies that they are mere delays."""

_ABRUPT = frozenset({"saturation", "two_rails", "fringe_ambiguity"})
"""Effects that cannot be faint: when small, they change only a few samples or none."""


def draw(seed: int, index: int, kind: ClassName) -> Truth:
    """Return what trial `index` of a proof conceals."""
    wanted = CLASSES[kind]
    rng = np.random.default_rng([seed, index])
    nonce = np.random.default_rng([seed, index, 1]).bytes(16).hex()
    moved = kind == "moved" or (kind != "nothing" and bool(rng.random() < 0.3))
    for _ in range(_TRIES):
        names = _chosen(rng, kind, wanted)
        unit = draw_unit(rng, moved=moved, lacking=_lacking(names), warm="thermal_lag" in names)
        withheld, lives_in = _outside(names) if kind == "outsider" or wanted.structure else ((), ())
        begun = Truth(
            index=index,
            kind=kind,
            unit=unit,
            seed=0,
            moved=moved,
            withheld=withheld,
            lives_in=lives_in,
            nonce=nonce,
        )
        truth = _sized(rng, begun, names)
        if truth is not None:
            return truth
    raise UsageError(
        f"trial {index}: no {wanted.title} in {_TRIES} draws that the procedure {PROCEDURE} brings out; "
        "choose another --seed"
    )


def plan_of(unit: TrialUnit) -> Plan:
    """Return the plan that a unit runs."""
    return find_procedure(PROCEDURE).expand(unit.parameters)


def _outside(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the effects that are withheld, and the coordinates in which they appear."""
    found = {name: kind for name in names if (kind := structure_named(name)) is not None}
    if found:
        return tuple(found), tuple(word for kind in found.values() for word in kind.word.split("*"))
    look_alikes, lives_in = OUTSIDERS[names[0]]
    return (names[0], *look_alikes), lives_in


def _chosen(rng: np.random.Generator, kind: ClassName, wanted: TrialClass) -> list[str]:
    """Draw the names of the concealed effects."""
    names = [str(rng.choice(WANDERING))] if wanted.wandering else []
    if wanted.structure:  # only one for a faint trial: two would have a larger gain
        structures = drawn_structures(rng, predicted=wanted.share is None or wanted.wandering)
        names += structures[:1] if wanted.share is None else structures
    pool, so_many = _pool(kind, wanted), len(names) + wanted.effects
    while len(names) < so_many:
        name = pool[int(rng.integers(len(pool)))]
        if not alike(name, names):
            names.append(name)
    return names


def _pool(kind: ClassName, wanted: TrialClass) -> Sequence[str]:
    if kind == "outsider":
        return tuple(OUTSIDERS)
    if wanted.share == 1.0:
        return tuple(name for name in DRAWN if not (wanted.wandering and name in WANDERING))
    without = STATISTICAL | _DELAYS | (_ABRUPT if wanted.share is None else frozenset())
    return tuple(name for name in DRAWN if name not in without)


def alike(name: str, names: Collection[str]) -> bool:
    """Return whether an effect is one of these, or cannot be distinguished from one of them by a single run."""
    return name in names or any(name in group and not group.isdisjoint(names) for group in _ALIKE)


def _lacking(names: Collection[str]) -> frozenset[str]:
    """Return the terms that the lab's model must lack, so that these effects are missing physics."""
    terms = {"rate_nonlinearity": "k_omega", "scale_temperature": "k_T"}
    return frozenset(term for name, term in terms.items() if name in names)


def _sized(rng: np.random.Generator, truth: Truth, names: Sequence[str]) -> Truth | None:
    """Return the truth with effects of the size that its class requires; None if the run would not reveal them."""
    share = CLASSES[truth.kind].share
    run = planned(plan_of(truth.unit), truth.unit)
    for name in names:
        of_structure = structure_named(name) is not None
        full = structure_size(name, rng, truth.unit) if of_structure else drawn_size(name, rng, truth.unit)
        reduced = _faint_share(run, truth, name, full) if share is None else share
        if reduced is None:
            return None
        size = shrunk(name, full, reduced, truth.unit) if share is None or not of_structure else full
        alone = replace(truth, effects={name: size})
        truth = replace(truth, effects={**truth.effects, name: size})
        drawn = name in STATISTICAL or "_of_noise_" in name
        if not drawn and share is not None and not _brought_out(run, alone, truth):
            return None
    known = STATISTICAL.isdisjoint(names) and not any("_of_noise_" in name for name in names)
    return replace(
        truth, seed=int(rng.integers(2**31)), gain=rounded(run.gain(truth.made())) if names and known else None
    )


def _brought_out(run: Planned, alone: Truth, truth: Truth) -> bool:
    """Return whether a run reveals an effect, both alone and in the presence of the truth's wandering bias."""
    wandering = {name: truth.effects[name] for name in WANDERING if name in truth.effects}
    made = alone.made()
    return run.gain(made) >= LEAST_GAIN and (not wandering or run.gain(made, wandering) >= FAINT_GAIN)


def _faint_share(run: Planned, truth: Truth, name: str, full: Values) -> float | None:
    """Return the share of an effect's full size whose gain is `FAINT_GAIN`, to a few percent; None if there is none."""

    def excess(log_share: float) -> float:
        size = shrunk(name, full, math.exp(log_share), truth.unit)
        return math.log(max(run.gain(replace(truth, effects={name: size}).made()), 1e-9) / FAINT_GAIN)

    low, high = math.log(_least_share(truth, name, full)), 0.0
    if excess(high) < 0.0:
        return 1.0
    if excess(low) > 0.0:
        return None
    return rounded(math.exp(brentq(excess, low, high, xtol=0.01)))


def _least_share(truth: Truth, name: str, full: Values) -> float:
    """Return the smallest share to try, at which the effect's parameters are still within their bounds."""
    bounds = effect(name).parameters
    share = _LEAST_SHARE
    while not all(
        bounds[each].low <= value <= bounds[each].high for each, value in shrunk(name, full, share, truth.unit).items()
    ):
        share *= 2.0
    return share


def rounded(value: float) -> float:
    """Return four digits of a value: the last bits of a sum depend on the machine, a sealed truth must not."""
    return float(f"{value:.4g}")


OUTSIDERS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = MappingProxyType(
    {
        "heading_dependent_bias": (("encoder_eccentricity", "encoder_interpolation"), ("angle",)),
        "encoder_eccentricity": (("heading_dependent_bias", "encoder_interpolation"), ("angle", "rate")),
        "rate_squared": (("scale_asymmetry", "adc_nonlinearity"), ("rate", "abs_rate", "rate_sign", "output")),
        "scale_asymmetry": (
            ("rate_squared", "dead_zone", "adc_nonlinearity"),
            ("rate", "abs_rate", "rate_sign", "output"),
        ),
        "dead_zone": (
            ("scale_asymmetry", "adc_nonlinearity", "rate_nonlinearity"),
            ("rate", "abs_rate", "rate_sign", "output"),
        ),
        "adc_nonlinearity": (("adc_coarse",), ("output", "rate", "abs_rate")),
        "bias_temperature": (
            ("bias_temperature_rate", "warm_up", "bias_drift", *WANDERING),
            ("gyro_temp", "chamber_temp", "time", "step"),
        ),
        "bias_temperature_rate": (
            ("bias_temperature", "thermal_lag", *WANDERING),
            ("gyro_temp_rate", "gyro_temp", "chamber_temp", "time", "step"),
        ),
        "warm_up": (("bias_drift", "bias_temperature", *WANDERING), ("time", "step")),
        "angular_acceleration": (
            ("timing_offset", "sensor_bandwidth", "mount_resonance", "clock_drift"),
            ("acceleration", "frequency"),
        ),
    }
)
"""Effects whose own hypothesis is withheld, with their withheld look-alikes and the coordinates they appear in."""
