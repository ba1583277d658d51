"""What a piece of omitted physics must say of itself: one description serves the simulated bench and the diagnosis.

An effect is a frozen dataclass whose fields are its parameters, under the names and units of the vocabulary, and, with
defaults, its circumstances (a reference temperature, a seed), which nobody fits. Its class says the rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Literal, Self

from benchctl_instruments.physics.chain import Signals, Stage

Role = Literal["size", "shape", "phase", "choice", "assumed"]
"""`size`: the effect grows in proportion to it; `shape`: a time constant, a cutoff; `phase`: an angle, periodic, in
degrees; `choice`: one of `scan`, whole numbers for example; `assumed`: a value that is not fitted (`assuming`)."""


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
"""The words for where a mismatch lives; two joined by `*` where it takes two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter of an effect.

    Attributes
    ----------
    unit
        Its unit, in CF style where there is one.
    meaning
        In words, short.
    low, high
        Bounds beyond which the effect is another one, or none.
    role
        How a search treats it.
    scan
        Where a search begins: of a size one value, small; of others values that cover what is likely, near enough that
        one of them leads to the right one.
    zero
        The value at which the effect is gone (`math.inf` for a cutoff); None where it does not depend on this one.
    logarithmic
        Whether it is positive and its ratios count.
    relative
        Whether it is by how much something positive differs, as a share of it: how well it is known, ratios of one and
        it tell.
    by_scan
        Whether it has far more places than can be listed, so that a search asks the residual for them; `scan` then only
        names some.
    nudge
        The change of its logarithm over which a derivative by it is taken: what it does is in proportion over so much.
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
        """The same within narrower bounds, with the places of its scan that are inside; between them if none is."""
        low, high = max(low, self.low), min(high, self.high)
        scan = tuple(place for place in self.scan if low <= place <= high)
        return replace(self, low=low, high=high, scan=scan or ((low * high) ** 0.5,))


class DescribedEffect(ABC):
    """Physics beside a part's baseline; a subclass is a frozen dataclass and sets every class variable.

    Attributes
    ----------
    identifier
        Its name in the vocabulary.
    words
        What it is, in one or two sentences, for someone who has not heard of it.
    equation
        Its equation, in the symbols of the vocabulary.
    coordinate
        Where its residual is seen: one of `COORDINATES`, or two joined by `*`.
    excited_by
        The motion or temperature that brings it out.
    look_alikes
        Identifiers of effects that can be mistaken for it.
    parameters
        Its parameters by name; in the order of its fields.
    several
        Whether a model may have several, which differ in what is chosen of them: orders. Such an effect keeps no memory
        and draws nothing.
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
        """The finding in one sentence, with its numbers."""

    @classmethod
    def within(cls, limits: Mapping[str, tuple[float, float]]) -> type[Self]:
        """The same effect with narrower bounds of some parameters: what is plausible for an instrument or a bench."""
        narrower = {name: one.within(*limits[name]) if name in limits else one for name, one in cls.parameters.items()}
        return type(cls.__name__, (cls,), {"parameters": narrower, "__slots__": ()})

    @property
    def plausible(self) -> bool:
        """Whether its parameters go together, each within its bounds, on anything that can be built."""
        return True

    def assuming(self, names: Collection[str]) -> Self | None:
        """The same effect with plausible values assumed for parameters that a fit moved to their bounds.

        None where an effect that stands at these bounds is another one, or none.
        """
        del names
        return None

    @classmethod
    def make(cls, values: Mapping[str, float], circumstances: Mapping[str, float] | None = None) -> Self:
        """An effect from its parameters by name; of the circumstances those that it has are taken."""
        known = {field.name for field in fields(cls)}  # type: ignore[arg-type]  # subclasses are dataclasses
        given = {name: value for name, value in (circumstances or {}).items() if name in known}
        return cls(**{**given, **values})

    @property
    def values(self) -> dict[str, float]:
        """Its parameters by name."""
        return {name: float(getattr(self, name)) for name in self.parameters}


class PhysicalEffect(DescribedEffect):
    """Physics of the gyro and what measures it.

    Attributes
    ----------
    stage
        That of the chain after whose baseline it acts.
    momentary
        Whether it answers to the momentary rate, acceleration or voltage otherwise than in proportion, or rings above a
        band: of a motion whose slow part alone is compared it shows on the average only.
    pointwise
        Whether what it makes of a sample depends on nothing but that sample: then it may be given all stretches of a
        recording in one row after another, where it would be given one at a time.
    timeless
        Whether what it makes of a sample depends on those before it, but not on when they were: then so may it, as long
        as no other recording begins.
    """

    stage: ClassVar[Stage]
    momentary: ClassVar[bool] = False
    pointwise: ClassVar[bool] = False
    timeless: ClassVar[bool] = False

    @abstractmethod
    def apply(self, signals: Signals) -> Signals:
        """The signals with the effect: of a stretch that may go on from an earlier one, by `Signals.memory`."""
