"""How often the interval of each result of an acceptance holds the true value: units of known values, by chance.

    python -m tests.benchmarks.metric_coverage --trials 500 --jobs 2 [--json FILE]

Each trial draws the noise of a unit, its turn-ons, and the errors of the bench's instruments from the figures that are
assumed where no certificate states any; `tests/benchctl/metrology/made_unit.py` has the unit.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from benchctl.metrology import propagation
from benchctl.metrology.acceptance import measured_in
from benchctl.metrology.observations import Settings
from benchctl.metrology.result import Measured
from benchctl.plan import set_points
from benchctl_procedures.acceptance import acceptance
from tests.benchctl.metrology.known_values import LINEARITY_PERCENT, known_values
from tests.benchctl.metrology.made_unit import MadeUnit, recorded

RATES, SET_POINTS, REST_S = 5, 3, 900.0
FREQUENCIES_HZ = (0.5, 1.0, 1.5, 1.9, 2.1, 2.5, 4.0)
PARAMETERS = {
    "coldest_c": "-20",
    "hottest_c": "60",
    "points": str(SET_POINTS),
    "top_rate_dps": "100",
    "sweep_rates": str(RATES),
    "rate_dps": "60",
    "rates": "3",
    "warm_s": "2400",
    "steps_dps": "0.01,0.02,0.03,0.045,0.06",
    "small_run_s": "60",
    "frequencies_hz": ",".join(map(str, FREQUENCIES_HZ)),
    "rest_s": str(REST_S),
    "ramp_c_per_min": "1",
}
_DRAWS = 3000
"""Of the Monte Carlo in every result: an interval's half-width to 2 %."""


@dataclass(frozen=True, slots=True)
class Miss:
    """Of one result of one trial: measured less true value, in expanded uncertainties."""

    name: str
    miss: float


def measured_and_known(seed: int) -> tuple[tuple[Measured, ...], dict[str, float]]:
    """The results of one unit on one bench, and the true values by their names."""
    recording, made = recorded(acceptance.expand(PARAMETERS).steps, MadeUnit(), seed)
    upward = set_points(-20.0, 60.0, SET_POINTS)
    known = known_values(made, RATES, (*upward, *upward[-2:0:-1]), FREQUENCIES_HZ[0], REST_S)
    with mock.patch.object(propagation, "_DRAWS", _DRAWS):
        return measured_in(recording, Settings(linearity_percent=LINEARITY_PERCENT)), known


def trial(seed: int) -> list[Miss]:
    """All results of one unit; those that are refused or only bounds are left out."""
    results, known = measured_and_known(seed)
    return [
        Miss(one.name, float((one.value - known[one.name]) / one.uncertainty.expanded))
        for one in results
        if one.value is not None and one.uncertainty is not None and not one.bound and one.name in known
    ]


def counted(trials: int, first_seed: int, jobs: int) -> dict[str, tuple[int, int, float]]:
    """By result: how many held, of how many, and the root mean square of the miss in expanded uncertainties."""
    misses: dict[str, list[float]] = defaultdict(list)
    with ProcessPoolExecutor(jobs) as pool:
        for results in pool.map(trial, range(first_seed, first_seed + trials)):
            for one in results:
                misses[one.name].append(one.miss)
    return {
        name: (sum(abs(miss) <= 1.0 for miss in found), len(found), math.sqrt(statistics.fmean(m * m for m in found)))
        for name, found in misses.items()
    }


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found = counted(asked.trials, asked.seed, asked.jobs)
    for name, (held, total, miss) in found.items():
        print(f"{name:30s} {held:5d} of {total:5d}  {100 * held / total:5.1f} %   rms miss {miss:.2f} U")  # noqa: T201
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
