"""Units just beyond a limit and just inside: how often they are accepted or rejected, and what the rule promises.

    python -m tests.benchmarks.guard_bands --units 100 --jobs 2 [--json FILE]

Of every ten units one is bad: in one of ten known ways its true value lies beyond the limit by a quarter of the
expanded uncertainty. Another one is as near to its limit and good; the others are well inside. Units and benches are
those of `metric_coverage`. A result is judged with a guard band of one expanded uncertainty (k = 2).
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from scipy.stats import norm

from benchctl.calibration.uncertainty import K
from benchctl.metrology.result import Limit
from benchctl.metrology.verdict import judged, overall, rule_of
from tests.benchmarks.metric_coverage import measured_and_known

WAYS = (
    "scale_factor",
    "nonlinearity",
    "asymmetry",
    "hysteresis_rate",
    "scale_factor_temperature",
    "bias",
    "bias_repeatability",
    "hysteresis_temperature_scale",
    "misalignment",
    "warm_up_bias",
)
_BEYOND, _FAR = 0.25, 10.0
"""Expanded uncertainties between a true value and its limit: just beyond or inside, and far."""
_GUARD = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """A unit, whether one of its true values lies beyond its limit or just inside, and the verdict."""

    seed: int
    way: str
    state: str
    verdict: str


def unit_of(seed: int) -> Unit:
    """Make, measure and judge one unit."""
    results, known = measured_and_known(seed)
    way, state = WAYS[seed // 10 % len(WAYS)], {0: "bad", 5: "just good"}.get(seed % 10, "good")
    rule = rule_of(_GUARD)
    verdicts = []
    for one in results:
        if one.value is None or one.uncertainty is None or one.name not in known:
            continue
        near = {"bad": -_BEYOND, "just good": _BEYOND}.get(state, _FAR) if one.name == way else _FAR
        high = known[one.name] + near * one.uncertainty.expanded
        verdicts.append(judged(one, Limit(low=None, high=high, unit=one.unit), rule))
    return Unit(seed=seed, way=way, state=state, verdict=overall(tuple(verdicts)))


def promised() -> float:
    """The share of units as near to a limit as ours that are at most judged as if they lay on its other side."""
    return float(norm.sf(K * (_GUARD + _BEYOND)))


def main() -> None:
    """Judge the units and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.jobs) as pool:
        units = list(pool.map(unit_of, range(asked.units)))
    for state in ("bad", "just good", "good"):
        own = Counter(unit.verdict for unit in units if unit.state == state)
        told = ", ".join(f"{own[verdict]} {verdict}" for verdict in ("PASS", "FAIL", "INCONCLUSIVE"))
        print(f"{state:10s} {sum(own.values()):5d}: {told}")  # noqa: T201
    print(f"promised for bad ones accepted and just good ones rejected: {100 * promised():.2f} % at most")  # noqa: T201
    if asked.json:
        asked.json.write_text(json.dumps([asdict(unit) for unit in units], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
