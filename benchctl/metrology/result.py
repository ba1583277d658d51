"""Results of the tests of a gyro and their verdicts: frozen records for the reports.

Every value, uncertainty and contribution of a test is in the unit of that test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from benchctl.calibration.result import Contribution
from benchctl.tables import Table
from benchctl_instruments.arrays import FloatArray

PLACEHOLDERS: Mapping[str, tuple[str, ...]] = {
    # why a test has no value
    "needs_rates": ("found", "needed"),
    "needs_both_directions": (),
    "needs_rest": (),
    "needs_up_and_down": (),
    "needs_power_cycles": ("found", "needed"),
    "needs_set_points": ("found", "needed"),
    "needs_both_legs": (),
    "needs_ramps": (),
    "needs_small_rates": (),
    "needs_rate_steps": (),
    "needs_slow_swing": (),
    "needs_sines": ("found", "needed"),
    "needs_across": (),
    "needs_power_on": (),
    "needs_long_rest": ("found_s", "needed_s"),
    "needs_scale_factor": (),
    "term_refused": ("why",),
    "no_settling_seen": (),
    # notes on a value
    "line_up_to": ("limit_dps",),
    "within_linearity": ("percent",),
    "earth_taken_off": ("rate_deg_per_h",),
    "latitude_unknown": (),
    "of_these_cycles": ("cycles", "low", "high"),
    "not_told_from_zero": (),
    "warm_up_law": ("amplitude", "tau_s", "within"),
    "allan_minimum": ("value", "tau_s"),
    "terms_misfit": ("tau_s", "value", "modelled"),
    "mean_of": ("seconds", "count"),
    "lag_included": (),
    "gaps": ("count", "step"),
    # how uncertainty was stated
    "as_tried": (),
    "gum_agrees": ("difference_percent",),
    "chi_square": ("low", "high"),
    "not_linear": ("difference_percent",),
    "not_normal": ("difference_percent", "source"),
    "size_of_changes": ("difference_percent",),
    # how it was judged
    "rule_guarded": ("guard", "risk_percent"),
    "rule_simple": (),
    "longer": ("times", "source"),
    "better_instrument": ("source",),
    "too_near": (),
    "run_procedure": ("procedure",),
    # anomalies of a recording
    "certificate_expired": ("role", "model", "date"),
    "not_whole": ("step",),
    "not_complete": ("status",),
    "no_digest": (),
    "foreign": (),
}
"""Every key and the names of its numbers; the reports' catalogues have a sentence for each, in each language."""


@dataclass(frozen=True, slots=True)
class Message:
    """One sentence: a key of `PLACEHOLDERS` and its numbers or words."""

    key: str
    values: Mapping[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if set(self.values) != set(PLACEHOLDERS[self.key]):
            raise ValueError(f"{self.key}: has {sorted(self.values)}, expected {PLACEHOLDERS[self.key]}")


def message(key: str, **values: float | str) -> Message:
    """Return a sentence by its key."""
    return Message(key, values)


Verdict = Literal["PASS", "FAIL", "INCONCLUSIVE"]
Bound = Literal["", "at least", "at most"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """The uncertainty of a value.

    `standard` is the combined standard uncertainty by the law of propagation (GUM, 5.1) and `dof` its effective degrees
    of freedom. `monte_carlo` is half the width of the interval that holds 95.45 % of the values drawn by Monte Carlo
    (JCGM 101). `expanded` is the reported uncertainty: `standard` times the coverage factor for `dof` (2 where it is
    infinite), or `monte_carlo` where the two differ by more than 5 %; `says` is the message that explains the choice.
    `contributors` are sorted, the largest first.
    """

    standard: float
    expanded: float
    dof: float = math.inf
    monte_carlo: float
    contributors: tuple[Contribution, ...]
    says: Message

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
    """A line or points of a plot, shape (n,) each; `label` is a key of the reports' catalogues.

    `standard` is the standard uncertainty of `y`, if it is known.
    """

    label: str
    x: FloatArray
    y: FloatArray
    dots: bool = True
    standard: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A plot of a test's readings with the residual of its law below; labels are keys of the reports' catalogues.

    `limited` is the axis on which the test's limit is drawn; a limit of magnitudes holds on both sides of zero.
    """

    x: str
    x_unit: str
    y: str
    y_unit: str
    traces: tuple[Trace, ...]
    left: tuple[Trace, ...] = ()
    left_unit: str = ""
    logarithmic: bool = False
    limited: Literal["", "x", "y"] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The result of one test.

    `value` is None if the recording does not contain what the test needs; `refused` states what is missing. `bound`:
    the value is only a limit of what the recording can show. `steps` are the indices of the steps used.
    """

    name: str
    unit: str
    value: float | None = None
    uncertainty: Uncertainty | None = None
    bound: Bound = ""
    refused: Message | None = None
    notes: tuple[Message, ...] = ()
    temperature_c: float | None = None
    steps: tuple[int, ...] = ()
    table: tuple[Column, ...] = ()
    picture: Picture | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """The permitted range of a value, ends included, in `unit`; None: no limit on that side."""

    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A result compared with its limit; `verdict` is None if there is no limit.

    `measured` is in the limit's unit. `remedy` states what would make an INCONCLUSIVE verdict conclusive.
    """

    measured: Measured
    limit: Limit | None
    verdict: Verdict | None
    remedy: Message | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """The decision rule: `guard` is the width of the guard band in expanded uncertainties; 0: simple acceptance."""

    guard: float
    says: Message


class Papers(Table):
    """The header of a report, as the file of limits states it."""

    title: str = ""
    number: str = ""
    revision: str = ""
    customer: str = ""
    standard: str = ""
    stage: str = ""
    firmware: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """All tests of one recording, judged.

    `limits_text` is the file of limits and `limits_sha256` its digest; `anomalies` are those of the recording;
    `step_digests` are the digests of its steps, by index.
    """

    verdict: Verdict
    rule: Rule
    judged: tuple[Judged, ...]
    papers: Papers
    limits_name: str
    limits_sha256: str
    limits_text: str = ""
    anomalies: tuple[Message, ...] = ()
    step_digests: Mapping[int, str] = field(default_factory=dict)
