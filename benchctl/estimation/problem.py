"""The interface of a part of the bench for the engine: a measured quantity, and a model of it that effects can change.

The engine (noise, screening, joint fits, selection, residual analysis) works on any `Problem`; the gyro, the table's
drive and the chamber each implement one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, Self

from benchctl.recordings.model import StepInfo
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


class Problem(Protocol):
    """A part of the bench, as recorded, with its lab's model.

    Arrays have one row per sample, shape (n,), in order of time; `step` is the index of a row's step in `step_names`.
    """

    @property
    def measured(self) -> FloatArray:
        """The quantity to be predicted, in `unit`."""

    @property
    def unit(self) -> str:
        """Unit of `measured`."""

    @property
    def full_scale(self) -> float:
        """The largest output within the rated range; changes of the bias are judged relative to it."""

    @property
    def time_s(self) -> FloatArray:
        """Time stamps, s."""

    @property
    def interval_s(self) -> float:
        """Time between two samples of a stretch."""

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The gap-free parts."""

    @property
    def step(self) -> IntArray:
        """The step of each row."""

    @property
    def step_names(self) -> tuple[str, ...]:
        """Names of the steps."""

    @property
    def step_kinds(self) -> tuple[str, ...]:
        """Kinds of the steps."""

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        """The steps with their beginnings and ends; a part may cut a recording's steps into pieces."""

    @property
    def recorded(self) -> IntArray:
        """For each step, which of the joined recordings of one instrument it belongs to, shape (m,)."""

    @property
    def usable(self) -> BoolArray:
        """Rows that may be fitted; the others are known to be bad."""

    @property
    def baseline_names(self) -> tuple[str, ...]:
        """Parameters of the lab's model, by the names of their format."""

    @property
    def baseline_units(self) -> tuple[str, ...]:
        """Units of these parameters."""

    @property
    def baseline_start(self) -> FloatArray:
        """Values of these parameters in the lab's model, shape (p,)."""

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """Bounds of baseline parameters by physics and the bench; parameters that are not listed are free."""

    @property
    def believed(self) -> bool:
        """Whether `baseline_start` is a lab's model; otherwise it was estimated from the recording itself."""

    @property
    def noises(self) -> frozenset[str]:
        """Identifiers of the hypotheses about the noise: a wandering bias, noise that grows with the rate."""

    @property
    def disturbed(self) -> bool:
        """Whether disturbances of `measured` last long, so that residuals are correlated even if nothing is missing.

        Models are fitted to `measured` itself, and each is compared together with the disturbance that it implies.
        """

    def forgetting(self, baseline: FloatArray, effects: Sequence[Any]) -> Sequence[tuple[float, float]]:
        """Return the rates [1/s] at which a model's `disturbed` quantity forgets disturbances, and their powers."""

    @property
    def rounding(self) -> float:
        """Standard deviation of the rounding of `measured`; 0 if it is far below the noise."""

    @property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """Variance [unit²] due to noise of the model's inputs, and that of half a row-to-row difference; (n,) each."""

    @property
    def circumstances(self) -> Mapping[str, float]:
        """Quantities that effects need in addition to their parameters."""

    @property
    def effects(self) -> Mapping[str, type[DescribedEffect]]:
        """The hypotheses, by identifier."""

    @property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Coordinates in which a mismatch is searched for, by the words of `result.COORDINATES`."""

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the model's value of `measured`, shape (n,), for baseline parameters (p,) and effects."""

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return further residuals, gains and phases, in standard deviations times a row's noise, shape (w,)."""

    @property
    def spectral_step(self) -> IntArray:
        """The step of each of these residuals, shape (w,)."""

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterable[tuple[FloatArray, DescribedEffect]]:
        """Yield effects of moderate size to be added to a model, each with a baseline (p,) as start of a fit.

        They are tried in addition to the starts from screening small effects.
        """

    def thinned(self) -> Self | None:
        """Return the same with fewer rows, for a first search for what is missing; None if there are few enough."""

    def forget(self) -> None:
        """Release data that is kept only to speed up the next prediction."""

    def otherwise(self) -> Self | None:
        """Return the recording under the alternative assumption about what it does not state; None if there is none."""

    def matters(self, name: str, change: float) -> float:
        """Return the largest result of a change of a baseline parameter, as a share of full scale or scale factor."""

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """Return the tables of a model file for baseline parameters (p,) and effects; `noise` is that of a row."""

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """Return remarks of this part, given residuals before and after and the held-out rows, all of shape (n,)."""
