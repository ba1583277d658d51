"""How often the truth lies inside the stated 95 % intervals: `python -m tests.benchmarks.coverage --seeds 100`.

`-p NAME=VALUE` changes a parameter of its campaign, as of `benchctl run`: `-p points=3 -p soak_s=10min` records a gyro
that has not settled. `--gyro kvh_dsp1760` takes a digital gyro, whose frames are fitted, instead of the analogue one.

Each seed is a whole campaign on the simulated bench (without wires, smaller than the main job): its own noise, its own
bias walk, its own mounting of the encoder. An interval that is honest holds the truth in 95 of 100 seeds; with 100
seeds 90 to 99 are within chance.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchctl.bench import Bench, bench_of_text, load_bench, template
from benchctl.calibration.calibrate import calibrate
from benchctl.campaign.opened import open_bench, world_settings
from benchctl.campaign.runner import run_campaign
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from benchctl.signals.under_test import under_test

PARAMETERS = {
    "points": "7",
    "top_rate_dps": "170",
    "sweep_rates": "8",
    "rates": "3",
    "run_s": "10",
    "zero_s": "20",
    "sine_hz": "0.5,1.0",
    "verify_hz": "0.8",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One seed: whether each interval held the truth, its z score, and the error on runs kept aside."""

    seed: int
    held: Mapping[str, bool]
    z: Mapping[str, float]
    error_percent: Mapping[str, float]


def bench_with(gyro: str | None) -> Bench:
    """The simulated bench, with a digital gyro of this model as the unit under test; analogue without."""
    if gyro is None:
        return load_bench("simulated")
    return bench_of_text(f'{template()}[gyro]\nmodel = "{gyro}"\nframe_rate_hz = 250.0\n', "simulated")


def recorded(seed: int, parameters: Mapping[str, str], folder: Path, gyro: str | None = None) -> Path:
    """Run a campaign on the simulated bench, without wires if the gyro is analogue; returns its recording."""
    plan = find_procedure("two_stage").expand(dict(parameters))
    with open_bench(bench_with(gyro).with_seed(seed), wires=gyro is not None) as opened:
        return run_campaign(plan, opened, folder).recording


def truth(gyro: str | None = None) -> dict[str, float]:
    """The coefficients of the simulated gyro, the same for every seed; a digital one states its rate."""
    sensor = world_settings(bench_with(gyro)).gyro
    per_dps = 1.0 if gyro is None else sensor.K0_v_per_dps
    return {
        "K0_v_per_dps": sensor.K0_v_per_dps / per_dps,
        "U0_v": sensor.U0_v if gyro is None else 0.0,
        "S_rad_per_dps": sensor.S_rad_per_dps,
        "g1": sensor.g1_per_c,
        "g2": sensor.g2_per_c2,
        "c1": sensor.c1_v_per_c / per_dps,
        "c2": sensor.c2_v_per_c2 / per_dps,
    }


def trial(seed: int, changed: Mapping[str, str] | None = None, gyro: str | None = None) -> Trial:
    """Run and fit one small campaign, some of its parameters changed."""
    with (
        tempfile.TemporaryDirectory() as folder,
        open_recording(recorded(seed, PARAMETERS | dict(changed or {}), Path(folder), gyro)) as recording,
    ):
        unit = under_test(recording)
        result = calibrate(unit.steps(), unit.meta)
    true = truth(gyro)
    found = {name: result.best.parameter(name) for name in true}
    return Trial(
        seed=seed,
        held={name: found[name].ci95[0] <= value <= found[name].ci95[1] for name, value in true.items()},
        z={name: (found[name].value - value) / found[name].standard for name, value in true.items()},
        error_percent=dict(result.error_percent),
    )


def coverage(
    seeds: range, processes: int = 2, changed: Mapping[str, str] | None = None, gyro: str | None = None
) -> tuple[Counter[str], list[Trial]]:
    """How many seeds held each coefficient, and the trials."""
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        trials = list(pool.imap_unordered(partial(trial, changed=changed, gyro=gyro), seeds))
    return Counter(name for each in trials for name, held in each.held.items() if held), trials


def main() -> None:
    """Print a table, and write it where `--json` says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("-p", dest="changed", metavar="NAME=VALUE", action="append", default=[])
    parser.add_argument("--gyro", metavar="MODEL")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    changed = dict(text.split("=", 1) for text in arguments.changed)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    counts, trials = coverage(seeds, arguments.processes, changed, arguments.gyro)
    worst = {
        level: max(each.error_percent[level] for each in trials) for level in ("raw", "stage_1", "stage_2", "joint")
    }
    for name in trials[0].held:
        spread = (sum(each.z[name] ** 2 for each in trials) / len(trials)) ** 0.5
        print(f"{name:<14} held in {counts[name]} of {len(trials)}, z rms {spread:.2f}")  # noqa: T201
    print("largest error_percent: " + ", ".join(f"{level} {value:.3g}" for level, value in worst.items()))  # noqa: T201
    if arguments.json:
        arguments.json.write_text(json.dumps({"held": counts, "seeds": len(trials), "error_percent": worst}, indent=1))


if __name__ == "__main__":
    main()
