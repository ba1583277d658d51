"""What is said of a result, as a key and its numbers, so that a report can say it in any of its languages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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
    # what a reader must know beside the value
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
    # what is amiss with a recording
    "certificate_expired": ("role", "model", "date"),
    "not_whole": ("step",),
    "not_complete": ("status",),
    "no_digest": (),
    "foreign": (),
}
"""Every key and the names of its numbers; the catalogues of the reports have a sentence for each."""


@dataclass(frozen=True, slots=True)
class Said:
    """One sentence: a key of `PLACEHOLDERS` and its numbers or words."""

    key: str
    values: Mapping[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if set(self.values) != set(PLACEHOLDERS[self.key]):
            raise ValueError(f"{self.key}: has {sorted(self.values)}, expected {PLACEHOLDERS[self.key]}")


def said(key: str, **values: float | str) -> Said:
    """A sentence by its key."""
    return Said(key, values)
