"""What a fleet gains by a second worker and loses beside plain processes: `python -m tests.benchmarks`, `fleet_speed`.

64 small two-stage campaigns, simulated without the wire, a seed each, are fitted by `benchctl fleet` on two workers, on
one, and by a ProcessPoolExecutor of two spawned processes that do the same jobs by the same function. All times are
whole: starting the cluster or the pool, importing in its processes, fits, reports, results in their places, stopping.
Ten minutes on a quiet machine of two cores, most of them reports' drawings.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import benchctl
from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.campaign.stop import StopRequest
from benchctl.fleet.cluster import Settings, run_fleet
from benchctl.fleet.job import Job, Options
from benchctl.fleet.located import Located, located
from benchctl.fleet.places import place_of
from benchctl.fleet.work import work
from benchctl.plan.find import find_procedure
from tests.benchmarks.comparison import Comparison

COUNT, TURNS, WORKERS = 64, 3, 2
PARAMETERS = {
    "points": "4",
    "sweep_rates": "5",
    "rates": "2",
    "run_s": "3",
    "zero_s": "10",
    "sine_hz": "0.5,1.0",
    "verify_hz": "0.8",
    "soak_s": "600",
}
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def measured() -> list[Comparison]:
    """Two workers beside one, and beside plain processes."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # as dask's own workers have it
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        recordings = simulated(folder / "recordings", COUNT)
        ways: dict[str, Callable[[Path], None]] = {
            "two": lambda out: by_fleet(recordings, out, WORKERS),
            "one": lambda out: by_fleet(recordings, out, 1),
            "pool": lambda out: by_pool(recordings, out, WORKERS),
        }
        times_s: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(TURNS):
            for name, way in ways.items():
                times_s[name].append(timed(way, folder / "results"))
    two, one, pool = (statistics.median(times_s[name]) for name in ("two", "one", "pool"))
    what = f"fleet fit of {COUNT} recordings, {WORKERS} workers"
    return [
        Comparison(what, two, "s", "the same on 1 worker", one, "<=", 1 / 1.8),
        Comparison(what, two, "s", f"ProcessPoolExecutor, {WORKERS} spawned processes", pool, "<=", 1.1),
    ]


def simulated(folder: Path, count: int) -> list[Located]:
    """So many campaigns, of a seed each."""
    folder.mkdir(parents=True)
    with ProcessPoolExecutor(WORKERS, mp_context=multiprocessing.get_context("spawn")) as pool:
        list(pool.map(simulate, [folder / f"seed{seed:02d}.h5" for seed in range(count)], range(count)))
    return located([f"{folder}/*.h5"])[0]


def simulate(path: Path, seed: int) -> None:
    """One small campaign."""
    plan = find_procedure("two_stage").expand(PARAMETERS)
    with tempfile.TemporaryDirectory() as folder:
        with open_bench(load_bench("simulated").with_seed(seed), wires=False) as bench:
            outcome = run_campaign(plan, bench, Path(folder))
        shutil.move(outcome.recording, path)


def by_fleet(recordings: Sequence[Located], out: Path, workers: int) -> None:
    """As `benchctl fleet fit` does it."""
    fleet = run_fleet(
        "fit",
        recordings,
        Options(),
        Settings(workers=workers, out=str(out)),
        on_outcome=lambda job, outcome: None,
        say=lambda text: None,
        stop=StopRequest(),
    )
    assert len(fleet.ended("done")) == len(recordings), [one.reason for one in fleet.members]


def by_pool(recordings: Sequence[Located], out: Path, workers: int) -> None:
    """The same jobs by plain processes."""
    jobs = [
        Job(verb="fit", recording=one, place=place_of(one, "fit", str(out)), options=Options(), run="pool", again=False)
        for one in recordings
    ]
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        outcomes = list(pool.map(work, jobs, [benchctl.__version__] * len(jobs)))
    assert all(outcome.state == "done" for outcome in outcomes), [outcome.reason for outcome in outcomes]


def timed(way: Callable[[Path], None], out: Path) -> float:
    """Wall time of one way to do all; its results are thrown away."""
    begun_s = time.perf_counter()
    way(out)
    took_s = time.perf_counter() - begun_s
    shutil.rmtree(out)
    return took_s
