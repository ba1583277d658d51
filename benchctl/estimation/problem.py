"""What the engine must know of a part of the bench: a measured quantity, and a model of it that effects can change.

The engine (noise, screening, joint fits, selection, the rest) works on any `Problem`; the gyro, the table's drive and
the chamber each give theirs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, Self

from benchctl.recordings.model import StepInfo
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


class Problem(Protocol):
    """A part of the bench, as recorded, with the model that its lab believes in.

    Arrays have a row a sample, shape (n,), in the order of time; `step` is the place of a row's step in `step_names`.
    """

    @property
    def measured(self) -> FloatArray:
        """What is to be predicted, in `unit`."""

    @property
    def unit(self) -> str:
        """Unit of `measured`."""

    @property
    def full_scale(self) -> float:
        """The largest output that the rated range asks for: by it a change of the bias is judged."""

    @property
    def time_s(self) -> FloatArray:
        """Stamps, s."""

    @property
    def interval_s(self) -> float:
        """Between two samples of a stretch."""

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The parts without gaps."""

    @property
    def step(self) -> IntArray:
        """Which step a row belongs to."""

    @property
    def step_names(self) -> tuple[str, ...]:
        """Names of the steps."""

    @property
    def step_kinds(self) -> tuple[str, ...]:
        """Their kinds."""

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        """What the steps are, when each began and ended; a part may cut a recording's steps into pieces."""

    @property
    def recorded(self) -> IntArray:
        """In which of the joined recordings of one instrument each step is, shape (m,)."""

    @property
    def usable(self) -> BoolArray:
        """Rows that may be fitted; the others are known to be spoilt."""

    @property
    def baseline_names(self) -> tuple[str, ...]:
        """Parameters of the lab's model, under the names of their format."""

    @property
    def baseline_units(self) -> tuple[str, ...]:
        """Their units."""

    @property
    def baseline_start(self) -> FloatArray:
        """Their values as the lab believes them, shape (p,)."""

    @property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """What physics and the bench allow parameters of the baseline to be; those left out are free."""

    @property
    def believed(self) -> bool:
        """Whether `baseline_start` is a lab's model; where not, it was estimated from the recording itself."""

    @property
    def noises(self) -> frozenset[str]:
        """Identifiers of the hypotheses about the noise: a wandering bias, noise that grows with the rate."""

    @property
    def disturbed(self) -> bool:
        """Whether what disturbs `measured` is felt for long: misses then follow from each other whatever is missing.

        Models are fitted to `measured` itself, and each competes beside the disturbance that it needs.
        """

    def forgetting(self, baseline: FloatArray, effects: Sequence[Any]) -> Sequence[tuple[float, float]]:
        """The rates [1/s] with which a `disturbed` quantity forgets by a model what has pushed it, and their powers."""

    @property
    def rounding(self) -> float:
        """Deviation of what the steps of `measured` round off; 0 where they are far below the noise."""

    @property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """Variance [unit²] that noise of what is predicted from adds, and of half a step from row to row; (n,) each."""

    @property
    def circumstances(self) -> Mapping[str, float]:
        """What effects want to know beside their parameters."""

    @property
    def effects(self) -> Mapping[str, type[DescribedEffect]]:
        """The hypotheses, by identifier."""

    @property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Coordinates in which a mismatch is looked for, by the words of `result.COORDINATES`."""

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """The model's value of `measured`, shape (n,), for baseline parameters (p,) and effects."""

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """What else is compared, in deviations times that of a row's noise, shape (w,): gains and phases."""

    @property
    def spectral_step(self) -> IntArray:
        """Which step each of these belongs to, shape (w,)."""

    def starts(
        self, baseline: FloatArray, effects: Sequence[DescribedEffect]
    ) -> Iterable[tuple[FloatArray, DescribedEffect]]:
        """Effects of a fair size beside those of a model, each with a baseline (p,) to begin a fit with.

        They come beside where a screening of small ones sends a fit.
        """

    def thinned(self) -> Self | None:
        """The same with fewer rows, for a first look at what may be missing; None where all are few enough."""

    def forget(self) -> None:
        """Let go of what is only kept so that the next prediction is quick."""

    def otherwise(self) -> Self | None:
        """The same recording under the other answer to what it does not state; None where there is no such question."""

    def matters(self, name: str, change: float) -> float:
        """What a change of a parameter of the baseline does at most, as a share of full scale or of scale factor."""

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """The tables of a model file for baseline parameters (p,) and effects; `noise` is the deviation of a row."""

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """What this part adds in sentences, from residuals before and after and rows held out, all of shape (n,)."""
