"""The interface of a part of the bench for a diagnosis; base classes of all parts, and of those of slow samples."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, Self

import numpy as np

from benchctl.diagnosis.series import Pieces
from benchctl.estimation.problem import Problem
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import Recording
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


class Stepped(Protocol):
    """A part with steps: what follows from the steps, and default answers that a part overrides where it differs."""

    @property
    @abstractmethod
    def steps(self) -> tuple[StepInfo, ...]:
        """The steps with their beginnings and ends; a part may cut a recording's steps into pieces."""

    @property
    @abstractmethod
    def time_s(self) -> FloatArray:
        """Times of the rows [s], shape (n,)."""

    @property
    def clock_s(self) -> FloatArray:
        """The time that effects use [s], shape (n,): since the start of the joined recording that a row belongs to."""
        return self.time_s

    @property
    def step_names(self) -> tuple[str, ...]:
        """Names of the steps."""
        return tuple(info.name for info in self.steps)

    @property
    def step_kinds(self) -> tuple[str, ...]:
        """Kinds of the steps."""
        return tuple(info.kind for info in self.steps)

    @property
    def recorded(self) -> IntArray:
        """Index of the joined recording that each step belongs to, shape (m,): 0 for all if there is only one."""
        return np.zeros(len(self.steps), np.int64)

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return an empty array: nothing is compared in addition to the rows."""
        return np.zeros(0)

    @property
    def spectral_step(self) -> IntArray:
        """Empty: nothing is compared in addition to the rows."""
        return np.zeros(0, np.int64)

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """Empty: every parameter is free."""
        return {}

    @property
    def disturbed(self) -> bool:
        """False: the noise is white until the search finds other noise."""
        return False

    def forgetting(self, baseline: FloatArray, effects: Sequence[Any]) -> Sequence[tuple[float, float]]:
        """Return an empty sequence: noise acts at once and is not remembered."""
        return ()

    @property
    def rounding(self) -> float:
        """0: the rounding is far below the noise."""
        return 0.0

    @property
    def in_motion(self) -> bool:
        """Whether rows sample a motion that visits its states in many steps; else time and step follow any residual."""
        return False

    @property
    def rate_error_v(self) -> float:
        """Maximum error of commanded rates, as output in `unit`; 0 where the motion is measured."""
        return 0.0

    def require_rows(self, recording: Recording) -> None:
        """Raise `UsageError` if too few rows are usable; only a gyro's faults are removed after its problem is made."""
        return

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterable[tuple[FloatArray, DescribedEffect]]:
        """Return effects of moderate size to be added to a model, each with a baseline (p,) as start of a fit.

        They are tried in addition to the starts from screening small effects, which are close enough if there are none.
        """
        return ()

    def thinned(self) -> Self | None:
        """Return the same with fewer rows, for a first search for what is missing; None if there are few enough."""
        return None

    def forget(self) -> None:
        """Release data that is kept only to speed up the next prediction; by default there is none."""
        return

    def otherwise(self) -> Self | None:
        """Return the recording under the alternative assumption about what it does not state; None if there is none."""
        return None


class PartProblem(Stepped, Problem, Protocol):
    """A part of the bench for a diagnosis: a `Problem` in some `unit`, with hypotheses about what its model lacks."""

    @property
    def unit(self) -> str:
        """Unit of `measured`."""

    @property
    def baseline_units(self) -> tuple[str, ...]:
        """Units of the parameters of the lab's model."""

    @property
    def believed(self) -> bool:
        """Whether `baseline_start` is a lab's model; otherwise it was estimated from the recording itself."""

    @property
    def effects(self) -> Mapping[str, type[DescribedEffect]]:
        """The hypotheses, by identifier."""

    def matters(self, name: str, change: float) -> float:
        """Return the largest result of a change of a baseline parameter, as a share of full scale or scale factor."""

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """Return the tables of a model file for baseline parameters (p,) and effects; `noise` is that of a row."""

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """Return remarks of this part, given residuals before and after and the held-out rows, all of shape (n,)."""


class MadeRows(Protocol):
    """Rows, shape (m,), that are made of samples."""

    @property
    def time_s(self) -> FloatArray:
        """Times of the rows [s]."""

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Slices of rows without gaps."""

    @property
    def infos_of_rows(self) -> Pieces:
        """The pieces of steps, and the piece that each row belongs to."""


class MadeOfRows(Stepped):
    """A problem whose rows are made of samples and cut into pieces; its regressors have no noise."""

    @property
    @abstractmethod
    def made(self) -> MadeRows:
        """The rows."""

    @property
    def time_s(self) -> FloatArray:
        """Times of the rows [s], shape (m,)."""
        return self.made.time_s

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Slices of rows without gaps."""
        return self.made.stretches

    @property
    def step(self) -> IntArray:
        """Index of each row's step, shape (m,)."""
        return self.made.infos_of_rows.step

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        """The steps, or pieces of steps."""
        return self.made.infos_of_rows.infos

    @property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """Zeros, (m,) each: no regressor noise is known in addition to the noise of `measured`."""
        return np.zeros(self.step.size), np.zeros(self.step.size)
