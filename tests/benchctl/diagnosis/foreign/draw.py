"""Draws what a recording conceals."""

from __future__ import annotations

import numpy as np

from tests.benchctl.diagnosis.foreign import outsiders
from tests.benchctl.diagnosis.foreign.faint import LINEAR, scaled_to
from tests.benchctl.diagnosis.foreign.plans import plan
from tests.benchctl.diagnosis.foreign.sizes import DRAWS, outsider
from tests.benchctl.diagnosis.foreign.truth import Effects, Truth

KINDS = (
    "null",
    "moved",
    "single",
    "quarter",
    "tenth",
    "faint",
    "pair",
    "triple",
    "wander",
    "wander+one",
    "outsider",
)

EFFECTS = tuple(DRAWS)

_SIZES = {"quarter": 0.25, "tenth": 0.1}
_MANY = {"pair": 2, "triple": 3}
_WANDERING = ("bias_random_walk", "flicker_noise")
_FAINT_GAIN = 200.0

_ALIKE: tuple[frozenset[str], ...] = (
    frozenset({"timing_offset", "sensor_bandwidth", "angular_acceleration", "mount_resonance"}),
    frozenset({"warm_up", "bias_drift", "bias_random_walk", "flicker_noise"}),
    frozenset({"scale_warm_up", "scale_ageing"}),
    frozenset({"saturation", "fringe_ambiguity", "rate_nonlinearity"}),
    frozenset({"thermal_lag", "thermal_hysteresis"}),
    frozenset({"adc_coarse", "adc_nonlinearity"}),
)
"""Effects of which no recording hides two: one run of this kind cannot hold them apart."""


def draw(kind: str, seed: int) -> Truth:
    """What a recording of this kind (`KINDS`) conceals. Singles go through the vocabulary as the seed counts."""
    rng = np.random.default_rng((KINDS.index(kind), seed, 0xD2A3))
    bench, where = int(rng.integers(0, 3)), int(rng.integers(0, 3))
    here = Truth(kind=kind, bench=bench, plan=where)
    effects: Effects = {}
    moved = kind == "moved" or (kind not in ("null",) and bool(rng.random() < 0.3))

    def add(name: str, size: float = 1.0) -> None:
        effects[name] = DRAWS[name](rng, here.where, size)

    if kind in ("single", *_SIZES):
        add(EFFECTS[seed % len(EFFECTS)], _SIZES.get(kind, 1.0))
    elif kind == "faint":
        add(LINEAR[seed % len(LINEAR)])
        return scaled_to(_FAINT_GAIN, Truth(kind=kind, bench=bench, plan=where, effects=effects))
    elif kind in _MANY:
        for name in _several(_MANY[kind], rng):
            add(name)
    elif kind.startswith("wander"):
        add(_WANDERING[seed % 2 if kind == "wander" else int(rng.integers(0, 2))])
        if kind == "wander+one":
            free = [name for name in EFFECTS if not _alike(name, set(effects))]
            add(free[seed % len(free)])
    elif kind == "outsider":
        name = outsiders.NAMES[seed % len(outsiders.NAMES)]
        lasts = plan(here.where.range_dps, here.set_points)[-1]["t_end"]
        hidden = {name: outsider(name, rng, here.where, lasts)}
        return Truth(kind=kind, bench=bench, plan=where, outsiders=hidden, lives_in=outsiders.lives_in(name))
    return Truth(kind=kind, bench=bench, plan=where, effects=effects, coefficients_moved=moved)


def _several(count: int, rng: np.random.Generator) -> list[str]:
    """So many effects that can be held apart."""
    chosen: list[str] = []
    while len(chosen) < count:
        name = str(rng.choice(EFFECTS))
        if not _alike(name, set(chosen)):
            chosen.append(name)
    return chosen


def _alike(name: str, chosen: set[str]) -> bool:
    return name in chosen or any(name in group and group & chosen for group in _ALIKE)
