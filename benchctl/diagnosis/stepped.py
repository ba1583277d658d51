"""What every problem derives from its steps, and what those share whose rows are made of a part's slow samples."""

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
    """A problem with steps."""

    @property
    @abstractmethod
    def steps(self) -> tuple[StepInfo, ...]:
        """The steps, or pieces of them."""

    @property
    def step_names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(info.name for info in self.steps)

    @property
    def step_kinds(self) -> tuple[str, ...]:
        """Their kinds."""
        return tuple(info.kind for info in self.steps)

    @property
    def recorded(self) -> IntArray:
        """One recording."""
        return np.zeros(len(self.steps), np.int64)

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Nothing beside the rows."""
        return np.zeros(0)

    @property
    def spectral_step(self) -> IntArray:
        """Nothing beside the rows."""
        return np.zeros(0, np.int64)

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """None: every parameter is free."""
        return {}

    @property
    def disturbed(self) -> bool:
        """Not: noise is white until more is found."""
        return False

    def forgetting(self, baseline: FloatArray, effects: Sequence[Any]) -> Sequence[tuple[float, float]]:
        """None: noise is felt at once."""
        return ()

    @property
    def rounding(self) -> float:
        """Far below the noise."""
        return 0.0

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterable[tuple[FloatArray, DescribedEffect]]:
        """None: what a screening finds is near enough."""
        return ()

    def thinned(self) -> Self | None:
        """None: there are never many rows."""
        return None

    def forget(self) -> None:  # noqa: B027 - those that keep nothing have nothing to do
        """Nothing large is kept."""

    def otherwise(self) -> Self | None:
        """None: everything that matters is stated."""
        return None


class MadeRows(Protocol):
    """Rows of shape (m,) that are made of samples."""

    @property
    def time_s(self) -> FloatArray:
        """When they are [s]."""

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Those without gaps."""

    @property
    def infos_of_rows(self) -> Pieces:
        """Which piece of which step each belongs to."""


class MadeOfRows(Stepped):
    """A problem whose rows are made of samples and cut into pieces; what it is predicted from brings no noise."""

    @property
    @abstractmethod
    def made(self) -> MadeRows:
        """The rows."""

    @property
    def time_s(self) -> FloatArray:
        """Of the rows [s], shape (m,)."""
        return self.made.time_s

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Rows without gaps."""
        return self.made.stretches

    @property
    def step(self) -> IntArray:
        """Which step a row belongs to, shape (m,)."""
        return self.made.infos_of_rows.step

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        """The steps, or pieces of them."""
        return self.made.infos_of_rows.infos

    @property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """Nothing that is known apart from the noise of `measured`; (m,) each."""
        return np.zeros(self.step.size), np.zeros(self.step.size)
