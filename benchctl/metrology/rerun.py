"""Compare the results of two recordings of the same unit, test by test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from benchctl.metrology.result import Judged


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A test in two runs, both in the unit of the first one's result.

    `difference` is the second value minus the first, `uncertainty` is √(U1² + U2²), expanded (95.45 %), and `e_n` is
    their ratio, as in ISO/IEC 17043: beyond ±1 the two disagree. Influences common to both runs, such as the same
    instruments and their certificates, are in U1 and in U2 but not in the difference, so that `e_n` is smaller than it
    could be. All three are None if one has no value, or only a bound; the last two if an uncertainty is unknown.
    """

    first: Judged
    again: Judged
    difference: float | None = None
    uncertainty: float | None = None
    e_n: float | None = None

    @property
    def name(self) -> str:
        """The test's name."""
        return self.first.measured.name

    @property
    def is_told(self) -> bool:
        """Whether it is reported: one of the runs has a value, or it has a limit."""
        return any(one.limit is not None or one.measured.value is not None for one in (self.first, self.again))

    @property
    def differs(self) -> bool:
        """Whether |E_n| > 1, or only one of the two has a value, or only one of the two is a bound."""
        before, now = self.first.measured, self.again.measured
        if (before.value is None) != (now.value is None) or before.bound != now.bound:
            return True
        return self.e_n is not None and abs(self.e_n) > 1.0

    @property
    def verdict_changed(self) -> bool:
        """Whether the two verdicts differ; False if neither has a limit."""
        return self.first.verdict != self.again.verdict


def compared(first: Sequence[Judged], again: Sequence[Judged]) -> tuple[Compared, ...]:
    """Compare two runs test by test; both judged by the same limits, in the same order.

    Raises
    ------
    ValueError
        If they are not the same tests in the same units.
    """
    return tuple(_compared(before, now) for before, now in zip(first, again, strict=True))


def _compared(first: Judged, again: Judged) -> Compared:
    before, now = first.measured, again.measured
    if (before.name, before.unit) != (now.name, now.unit):
        raise ValueError(f"{before.name} in {before.unit} is not {now.name} in {now.unit}")
    if before.value is None or now.value is None or before.bound or now.bound:
        return Compared(first=first, again=again)
    difference = now.value - before.value
    if before.uncertainty is None or now.uncertainty is None:
        return Compared(first=first, again=again, difference=difference)
    combined = math.hypot(before.uncertainty.expanded, now.uncertainty.expanded)
    e_n = difference / combined if combined > 0.0 else None
    return Compared(first=first, again=again, difference=difference, uncertainty=combined, e_n=e_n)
