"""The result of a search: the chosen model and the evidence for each of its effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.search.screen import Screening
from benchctl.estimation.fit import Fit, Point
from benchctl.estimation.noise import Whitener
from benchctl.estimation.noise_model import NoiseModel
from benchctl_instruments.arrays import BoolArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The evidence for an effect in the model.

    `gain` is the loss in twice the log likelihood if the effect is dropped and all else refitted; `heldout` the same on
    held-out steps, where a correct effect gains less than `heldout_least` only by a rare chance. `scatter` is the ratio
    of the gain's scatter to that expected from white noise. `rivals` are the losses of evidence with each rival in its
    place; `excess` (n,) is the increase of each row's squared innovation without it; `nearest` is the model with the
    nearest rival.
    """

    gain: float
    heldout: float
    scatter: float
    excess: npt.NDArray[np.float32]
    rivals: Mapping[str, float] = field(default_factory=dict)
    nearest: Point | None = None
    heldout_least: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The chosen models. `before` has the baseline alone, `after` the findings; neither used the held-out steps.

    `full` is fitted to all steps. `evidence` has the keys of `after.point.effects`, in their order; `noise` is the
    noise model with its whitener; `least` is the gain that a further effect would have needed.
    """

    before: Fit
    after: Fit
    full: Fit
    noise: NoiseModel
    screening: Screening
    evidence: Mapping[str, Evidence]
    heldout: BoolArray
    least: float
    named: Fit | None = None
    """`after` without the unnamed structures; None if there are none."""
    noise_structure: DescribedEffect | None = None
    """An unnamed dependence of the noise on a coordinate, if any; the whitener includes it."""

    @property
    def identifiers(self) -> frozenset[str]:
        """The effects of the model, by name."""
        return frozenset(effect.identifier for effect in self.after.point.effects)

    @property
    def whitener(self) -> Whitener:
        """The filter that makes the noise white."""
        return self.noise.whitener

    @property
    def white_deviation(self) -> float:
        """Standard deviation of the white part of a row's noise."""
        return self.after.deviation / self.whitener.innovation
