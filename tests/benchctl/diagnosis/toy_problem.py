"""A part of the bench that is written down on one page: a line in the rate, and a handful of effects beside it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from benchctl.recordings.model import StepInfo
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

STEPS, ROWS, INTERVAL_S, PAUSE_S = 24, 100, 0.1, 30.0
RANGE_DPS, K0, U0, NOISE_V = 100.0, 0.02, 0.0, 1e-3
KINDS = ("static", "constant_rate", "sine")
"""None is called static: what is asked of static steps alone has no part in a toy."""


def _size(scan: float = 1e-4) -> Parameter:
    return Parameter(unit="V", meaning="size", low=-1.0, high=1.0, role="size", scan=(scan,), zero=0.0)


class ToyEffect(DescribedEffect):
    """Adds a column to the output."""

    words = equation = excited_by = "made up"
    coordinate = "rate"
    look_alikes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def column(self, problem: Toy) -> FloatArray:
        """What it adds, shape (n,)."""

    def says(self) -> str:
        return f"There is {self.identifier}."


@dataclass(frozen=True, slots=True, kw_only=True)
class Cubic(ToyEffect):
    size_v: float
    identifier: ClassVar[str] = "cubic"
    parameters: ClassVar[Mapping[str, Parameter]] = {"size_v": _size()}

    def column(self, problem: Toy) -> FloatArray:
        return self.size_v * problem.share**3


@dataclass(frozen=True, slots=True, kw_only=True)
class Quintic(ToyEffect):
    """Nearly the cubic: only the largest rates tell them apart."""

    size_v: float
    identifier: ClassVar[str] = "quintic"
    look_alikes: ClassVar[tuple[str, ...]] = ("cubic",)
    parameters: ClassVar[Mapping[str, Parameter]] = {"size_v": _size()}

    def column(self, problem: Toy) -> FloatArray:
        return self.size_v * problem.share**5


@dataclass(frozen=True, slots=True, kw_only=True)
class Squared(ToyEffect):
    size_v: float
    identifier: ClassVar[str] = "squared"
    coordinate: ClassVar[str] = "abs_rate"
    parameters: ClassVar[Mapping[str, Parameter]] = {"size_v": _size()}

    def column(self, problem: Toy) -> FloatArray:
        return self.size_v * problem.share**2


@dataclass(frozen=True, slots=True, kw_only=True)
class Decay(ToyEffect):
    amplitude_v: float
    tau_s: float
    identifier: ClassVar[str] = "decay"
    coordinate: ClassVar[str] = "time"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_v": _size(),
        "tau_s": Parameter(
            unit="s",
            meaning="time constant",
            low=10.0,
            high=1e4,
            role="shape",
            scan=(30.0, 100.0, 300.0),
            logarithmic=True,
        ),
    }

    def column(self, problem: Toy) -> FloatArray:
        return self.amplitude_v * np.exp(-problem.time_s / self.tau_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ripple(ToyEffect):
    """A wave in the angle, whose order is a choice: there may be one of each."""

    amplitude_v: float
    phase_deg: float
    order: float
    identifier: ClassVar[str] = "ripple"
    coordinate: ClassVar[str] = "angle"
    several: ClassVar[bool] = True
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "amplitude_v": _size(),
        "phase_deg": Parameter(unit="degree", meaning="phase", low=0.0, high=360.0, role="phase", scan=(0.0,)),
        "order": Parameter(unit="1", meaning="waves a turn", low=1.0, high=2.0, role="choice", scan=(1.0, 2.0)),
    }

    def column(self, problem: Toy) -> FloatArray:
        return self.amplitude_v * np.cos(self.order * np.radians(problem.coordinates["angle"] - self.phase_deg))


EFFECTS: Mapping[str, type[ToyEffect]] = {kind.identifier: kind for kind in (Cubic, Quintic, Squared, Decay, Ripple)}


@dataclass(frozen=True, kw_only=True)
class Toy:
    """A `PartProblem` of 24 steps, three kinds in turn, with a pause before each."""

    measured: FloatArray
    effects: Mapping[str, type[DescribedEffect]]
    noises: frozenset[str] = frozenset()
    usable: BoolArray
    regressor_variance: tuple[FloatArray, FloatArray]
    baseline_start: FloatArray
    believed: bool = True
    unit: str = "V"
    full_scale: float = K0 * RANGE_DPS
    interval_s: float = INTERVAL_S
    baseline_names: tuple[str, ...] = ("K0_v_per_dps", "U0_v")
    baseline_units: tuple[str, ...] = ("V/(deg/s)", "V")
    baseline_bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    disturbed: bool = False
    rounding: float = 0.0
    in_motion: bool = False
    rate_error_v: float = 0.0
    recorded: IntArray = field(default_factory=lambda: np.zeros(STEPS, np.int64))

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Sequence[tuple[FloatArray, DescribedEffect]]:
        return ()

    def thinned(self) -> None:
        return None

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        return np.zeros(0)

    @property
    def spectral_step(self) -> IntArray:
        return np.zeros(0, np.int64)

    @cached_property
    def time_s(self) -> FloatArray:
        return _TIME_S

    @property
    def stretches(self) -> tuple[slice, ...]:
        return tuple(slice(i * ROWS, (i + 1) * ROWS) for i in range(STEPS))

    @property
    def step(self) -> IntArray:
        return _STEP

    @property
    def step_names(self) -> tuple[str, ...]:
        return tuple(f"step {i}" for i in range(STEPS))

    @property
    def step_kinds(self) -> tuple[str, ...]:
        return tuple(KINDS[i % 3] for i in range(STEPS))

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        return tuple(
            StepInfo(
                index=i + 1,
                name=name,
                kind=kind,
                t_start=float(_TIME_S[i * ROWS]),
                t_end=float(_TIME_S[(i + 1) * ROWS - 1]),
                chamber_setpoint_c=20.0,
            )
            for i, (name, kind) in enumerate(zip(self.step_names, self.step_kinds, strict=True))
        )

    @property
    def share(self) -> FloatArray:
        """The rate over the range."""
        return _RATE_DPS / RANGE_DPS

    @property
    def circumstances(self) -> Mapping[str, float]:
        return {"range_dps": RANGE_DPS}

    @property
    def coordinates(self) -> Mapping[str, FloatArray]:
        return _COORDINATES

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        predicted: FloatArray = baseline[0] * _RATE_DPS + baseline[1]
        for one in effects:
            predicted = predicted + one.column(self)
        return predicted

    def matters(self, name: str, change: float) -> float:
        return abs(change) / (K0 if name == "K0_v_per_dps" else self.full_scale)

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        return {"simulation": baseline.tolist(), "noise": noise, "effects": [one.identifier for one in effects]}

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        return ()


def _motion() -> tuple[FloatArray, FloatArray, IntArray]:
    inside = INTERVAL_S * np.arange(ROWS)
    time_s = np.concatenate([i * (ROWS * INTERVAL_S + PAUSE_S) + inside for i in range(STEPS)])
    rates = []
    for i in range(STEPS):
        level = 100.0 * np.cos(2.4 * i)
        rates.append(
            {
                "static": np.zeros(ROWS),
                "constant_rate": np.full(ROWS, level),
                "sine": level * np.sin(2 * np.pi * 0.3 * inside + i),
            }[KINDS[i % 3]]
        )
    return time_s, np.concatenate(rates), np.repeat(np.arange(STEPS), ROWS)


_TIME_S, _RATE_DPS, _STEP = _motion()
_COORDINATES: Mapping[str, FloatArray] = {
    "time": _TIME_S,
    "rate": _RATE_DPS,
    "abs_rate": np.abs(_RATE_DPS),
    "angle": np.mod(np.cumsum(_RATE_DPS) * INTERVAL_S, 360.0),
    "step": _STEP.astype(np.float64),
}
TOTAL = STEPS * ROWS


def toy(
    *truth: ToyEffect,
    seed: int = 0,
    hypotheses: Sequence[type[DescribedEffect]] | None = None,
    noise_v: float = NOISE_V,
    added_v: FloatArray | float = 0.0,
    noises: Sequence[str] = (),
    baseline: tuple[float, float] = (K0, U0),
) -> Toy:
    """A recording of some effects and white noise; `baseline` is the true one, believed in are K0 and U0."""
    chance = np.random.default_rng(seed)
    kinds = EFFECTS if hypotheses is None else {kind.identifier: kind for kind in hypotheses}
    made = Toy(
        measured=np.zeros(TOTAL),
        effects=kinds,
        noises=frozenset(noises),
        usable=np.ones(TOTAL, np.bool_),
        regressor_variance=(np.zeros(TOTAL), np.zeros(TOTAL)),
        baseline_start=np.array([K0, U0]),
    )
    measured = made.predict(np.array(baseline), truth) + added_v + noise_v * chance.standard_normal(TOTAL)
    return replace(made, measured=measured)


def walked(per_root_s: float, seed: int) -> FloatArray:
    """A random walk of so many volts a root of a second, through the pauses too, shape (n,)."""
    steps = np.sqrt(np.diff(_TIME_S, prepend=_TIME_S[0])) * np.random.default_rng([seed, 7]).standard_normal(TOTAL)
    return np.asarray(per_root_s * np.cumsum(steps))
