"""What a search has chosen, and what speaks for each part of it."""

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
    """What speaks for an effect in the model.

    `gain` is lost in twice the log likelihood if it is dropped, all else refitted; `heldout` on held-out steps, where
    one that is right gains no less than `heldout_least` but by a rare chance. Chance scatters by `scatter` more than
    white noise would. `rivals` are the losses of evidence with each in its place;
    `excess` (n,) is what a row's squared innovation grows by without it; `nearest` the model with the nearest rival.
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
    """What was chosen. `before` has the baseline alone, `after` the findings; neither has seen the held-out steps.

    `whole` is fitted to all steps. `evidence` is by the keys of `after.point.effects`, in their order; `noise` what
    was found of the noise, with the whitener that goes with it; `least` is what anything more would have had to gain.
    """

    before: Fit
    after: Fit
    whole: Fit
    noise: NoiseModel
    screening: Screening
    evidence: Mapping[str, Evidence]
    heldout: BoolArray
    least: float
    named: Fit | None = None
    """`after` without the structures that have no name; None where there are none."""
    noise_structure: DescribedEffect | None = None
    """How the noise depends on something, where it does in a way that has no name; the whitener knows of it."""

    @property
    def whitener(self) -> Whitener:
        """What makes the noise white."""
        return self.noise.whitener

    @property
    def white_deviation(self) -> float:
        """Deviation of the white part of a row's noise."""
        return self.after.deviation / self.whitener.innovation
