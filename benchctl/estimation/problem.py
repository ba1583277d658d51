"""The interface of a part of the bench for fits and models of noise: a measured quantity, and a model that predicts it.

The gyro, the table's drive and the chamber each implement one; `benchctl.diagnosis.stepped` has what a diagnosis adds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray


class Problem(Protocol):
    """A part of the bench, as recorded, with its lab's model.

    Arrays have one row per sample, shape (n,), in order of time; `step` is the index of a row's step in `step_names`.
    """

    @property
    def measured(self) -> FloatArray:
        """The quantity to be predicted."""

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
    def usable(self) -> BoolArray:
        """Rows that may be fitted; the others are known to be bad."""

    @property
    def baseline_names(self) -> tuple[str, ...]:
        """Parameters of the lab's model, by the names of their format."""

    @property
    def baseline_start(self) -> FloatArray:
        """Values of these parameters in the lab's model, shape (p,)."""

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """Bounds of baseline parameters by physics and the bench; parameters that are not listed are free."""

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
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Coordinates in which a mismatch is searched for, by the words of `result.COORDINATES`."""

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the model's value of `measured`, shape (n,), for baseline parameters (p,) and effects."""

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return further residuals, gains and phases, in standard deviations times a row's noise, shape (w,)."""

    @property
    def spectral_step(self) -> IntArray:
        """The step of each of these residuals, shape (w,)."""
