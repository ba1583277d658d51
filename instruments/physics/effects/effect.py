"""The description of an effect, shared by the simulated bench and the diagnosis.

An effect is a frozen dataclass. Its fields are its parameters, with the names and units of the vocabulary, followed by
its circumstances (a reference temperature, a seed), which have defaults and are not fitted. Class variables describe
the effect.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Literal, Self

from benchctl_instruments.physics.chain import Signals, Stage

Role = Literal["size", "shape", "phase", "choice", "assumed"]
"""`size`: the effect is proportional to it; `shape`: a time constant, a cutoff; `phase`: an angle, periodic, in
degrees; `choice`: one of `scan`, integers for example; `assumed`: a value that is not fitted (`assuming`)."""


COORDINATES = (
    "time",
    "rate",
    "abs_rate",
    "rate_sign",
    "acceleration",
    "angle",
    "gyro_temp",
    "gyro_temp_rate",
    "chamber_temp",
    "chamber_temp_rate",
    "heater",
    "setpoint",
    "output",
    "frequency",
    "step",
)
"""The coordinates on which a residual depends; two are joined by `*`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter of an effect.

    Attributes
    ----------
    unit
        Its unit, in CF style if there is one.
    meaning
        A short description.
    low, high
        Bounds outside which it is a different effect, or none.
    role
        How a search treats it.
    scan
        Start values of a search: one small value for a size; otherwise values that cover the likely range, so dense
        that one of them leads to the solution.
    zero
        The value at which the effect vanishes (`math.inf` for a cutoff); None if there is no such value.
    logarithmic
        Whether it is positive and searched on a logarithmic scale.
    relative
        Whether it is the relative deviation of a positive quantity; its uncertainty is then described by ratios of one
        and it.
    by_scan
        Whether there are too many possible start values to list, so that a search derives them from the residual;
        `scan` then holds only some of them.
    nudge
        The step of its logarithm for numerical derivatives; the effect is linear over this step.
    """

    unit: str
    meaning: str
    low: float
    high: float
    role: Role
    scan: tuple[float, ...]
    zero: float | None = None
    logarithmic: bool = False
    relative: bool = False
    by_scan: bool = False
    nudge: float = 1e-3

    def within(self, low: float, high: float) -> Self:
        """Return it with narrower bounds and the start values inside; without any, their geometric mean."""
        low, high = max(low, self.low), min(high, self.high)
        scan = tuple(place for place in self.scan if low <= place <= high)
        return replace(self, low=low, high=high, scan=scan or ((low * high) ** 0.5,))


class DescribedEffect(ABC):
    """An effect that a baseline does not describe; a subclass is a frozen dataclass and sets every class variable.

    Attributes
    ----------
    identifier
        Its name in the vocabulary.
    words
        One or two sentences that explain it to a reader who does not know it.
    equation
        Its equation, in the symbols of the vocabulary.
    coordinate
        The coordinate on which its residual depends: one of `COORDINATES`, or two joined by `*`.
    excited_by
        The motion or temperature that excites it.
    look_alikes
        Identifiers of effects that can be mistaken for it.
    parameters
        Its parameters by name, in the order of its fields.
    several
        Whether a model may contain several of it, which differ in their `choice` parameters: orders. Such an effect has
        no memory and no random draws.
    """

    identifier: ClassVar[str]
    words: ClassVar[str]
    equation: ClassVar[str]
    coordinate: ClassVar[str]
    excited_by: ClassVar[str]
    look_alikes: ClassVar[tuple[str, ...]]
    parameters: ClassVar[Mapping[str, Parameter]]
    several: ClassVar[bool] = False

    @abstractmethod
    def says(self) -> str:
        """Return the finding in one sentence, with its numbers."""

    @classmethod
    def within(cls, limits: Mapping[str, tuple[float, float]]) -> type[Self]:
        """Return the effect with narrower bounds of some parameters: plausible ones for an instrument or a bench."""
        narrower = {name: one.within(*limits[name]) if name in limits else one for name, one in cls.parameters.items()}
        return type(cls.__name__, (cls,), {"parameters": narrower, "__slots__": ()})

    @property
    def plausible(self) -> bool:
        """Whether the combination of its parameters, each within its bounds, is physically possible."""
        return True

    def assuming(self, names: Collection[str]) -> Self | None:
        """Return the effect with plausible values assumed for parameters that a fit moved to their bounds.

        Returns None if the effect at these bounds is a different one, or none.
        """
        del names
        return None

    @classmethod
    def make(cls, values: Mapping[str, float], circumstances: Mapping[str, float] | None = None) -> Self:
        """Return an effect from its parameters by name; circumstances that it does not have are ignored."""
        known = {field.name for field in fields(cls)}  # type: ignore[arg-type]  # subclasses are dataclasses
        given = {name: value for name, value in (circumstances or {}).items() if name in known}
        return cls(**{**given, **values})

    @property
    def values(self) -> dict[str, float]:
        """Its parameters by name."""
        return {name: float(getattr(self, name)) for name in self.parameters}


class PhysicalEffect(DescribedEffect):
    """An effect of the gyro and its measurement chain.

    Attributes
    ----------
    stage
        The stage of the chain after whose baseline it acts.
    momentary
        Whether it responds nonlinearly to the momentary rate, acceleration or voltage, or resonates above a band: if
        only the slow part of a motion is compared, only its average is visible.
    pointwise
        Whether its output for a sample depends on that sample only: all segments of a recording can then be passed in
        one array, in any order.
    timeless
        Whether its output for a sample depends on earlier samples, but not on their times: segments of one recording
        can then be passed in one array, in order.
    """

    stage: ClassVar[Stage]
    momentary: ClassVar[bool] = False
    pointwise: ClassVar[bool] = False
    timeless: ClassVar[bool] = False

    @abstractmethod
    def apply(self, signals: Signals) -> Signals:
        """Return the signals of a segment with the effect; `Signals.memory` continues an earlier segment."""
