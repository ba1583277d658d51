"""Base classes: properties that all problems derive from their steps, and those of problems made of slow samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, Self

import numpy as np

from benchctl.diagnosis.series import Pieces
from benchctl.recordings.model import StepInfo
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


class Stepped(ABC):
    """A problem with steps, and the default answers to optional questions of `Problem`."""

    @property
    @abstractmethod
    def steps(self) -> tuple[StepInfo, ...]:
        """The steps, or pieces of steps."""

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
        """Index of the recording of each step: 0 for all, as there is only one recording."""
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

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterable[tuple[FloatArray, DescribedEffect]]:
        """Return no starts: those found by the screening are close enough."""
        return ()

    def thinned(self) -> Self | None:
        """Return None: there are never many rows."""
        return None

    def forget(self) -> None:  # noqa: B027 - the default does nothing
        """Do nothing: no large arrays are kept."""

    def otherwise(self) -> Self | None:
        """Return None: the recording states everything that matters."""
        return None


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
