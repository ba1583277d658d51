"""What the tests of a gyro found and how they were judged: the frozen records that reports are written from.

Every value, uncertainty and contribution of a test is in the unit of that test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from benchctl.calibration.result import Contribution
from benchctl.metrology.said import Said

FloatArray = npt.NDArray[np.float64]

Verdict = Literal["PASS", "FAIL", "INCONCLUSIVE"]
Bound = Literal["", "at least", "at most"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """How well a value is known.

    `standard` is the combined standard uncertainty by the law of propagation (GUM, 5.1) and `dof` its effective degrees
    of freedom. `monte_carlo` is half the width of the interval that holds 95.45 % of the values drawn by Monte Carlo
    (JCGM 101). `expanded` is what is stated: `standard` times the coverage factor that `dof` demands (2 where it is
    infinite), or `monte_carlo` where the two differ by more than 5 %; `says` tells which and why. `contributors` are
    sorted, the largest first.
    """

    standard: float
    expanded: float
    dof: float = math.inf
    monte_carlo: float
    contributors: tuple[Contribution, ...]
    says: Said

    @property
    def k(self) -> float | None:
        """The coverage factor that was used: expanded over standard; None where nothing contributes."""
        return self.expanded / self.standard if self.standard > 0.0 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column of a table of points: `name` is a key of the reports' catalogues."""

    name: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A line or dots in a picture, (n,) each; `label` is a key of the reports' catalogues."""

    label: str
    x: FloatArray
    y: FloatArray
    dots: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """What a test saw, and below it what its law leaves; labels are keys of the reports' catalogues."""

    x: str
    x_unit: str
    y: str
    y_unit: str
    traces: tuple[Trace, ...]
    left: tuple[Trace, ...] = ()
    left_unit: str = ""
    logarithmic: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The result of one test.

    `value` is None where the recording does not hold what the test needs; `refused` says what. `bound` says that the
    value is only a limit of what the recording can show. `steps` are the indices of the steps that it comes from.
    """

    name: str
    unit: str
    value: float | None = None
    uncertainty: Uncertainty | None = None
    bound: Bound = ""
    refused: Said | None = None
    notes: tuple[Said, ...] = ()
    temperature_c: float | None = None
    steps: tuple[int, ...] = ()
    table: tuple[Column, ...] = ()
    picture: Picture | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """What a value may be, ends included, in `unit`; None: no limit on that side."""

    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A result against its limit; `verdict` is None where there is no limit.

    `measured` is in the limit's unit. `remedy` says of an INCONCLUSIVE one what would make it conclusive.
    """

    measured: Measured
    limit: Limit | None
    verdict: Verdict | None
    remedy: Said | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """How values are judged: `guard` is the width of the guard band in expanded uncertainties; 0: simple acceptance."""

    guard: float
    says: Said


@dataclass(frozen=True, slots=True, kw_only=True)
class Papers:
    """The header of a report, as the file of limits states it."""

    title: str = ""
    customer: str = ""
    standard: str = ""
    stage: str = ""
    firmware: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """All tests of one recording, judged.

    `limits_text` is the file of limits, `limits_sha256` its digest; `anomalies` say what is amiss with the recording;
    `step_digests` are those of its steps, by index.
    """

    verdict: Verdict
    rule: Rule
    judged: tuple[Judged, ...]
    papers: Papers
    limits_name: str
    limits_sha256: str
    limits_text: str = ""
    anomalies: tuple[Said, ...] = ()
    step_digests: Mapping[int, str] = field(default_factory=dict)
