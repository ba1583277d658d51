"""The simulated bench: the main job against what it took before, and what its wires cost beside its physics alone.

The main job is the command of the README's first lines: 328 steps, 20 set points, 33.5 h of bench time, every byte over
a socket. It runs in turns with the version whose time the README first stated, out of this repository's history, or
stands beside that time where there is no history. Wires and protocols are then measured apart from the rest: the same
bench is streamed from, and soaked, without any, by method calls, where only the same physics is computed, sample by
sample the same.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchctl import api
from benchctl.app.run import Watch, play
from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from tests.benchmarks.comparison import Comparison, alternating

ROOT = Path(__file__).resolve().parents[2]
BEFORE = "bf34adf"
"""The commit whose README stated the main job's time first."""

HALF = 0.5
OF_ITS_PHYSICS = 0.5
"""The share of a bench without wires that the one with wires has to reach: they may cost as much as the physics do."""

OF_ITS_PHYSICS_IN_A_SOAK = 0.25
"""In a soak next to nothing is computed: 19 questions and answers each half minute are all there is."""

_JOBS, _TURNS = 3, 5
_CHUNK_S, _STREAMED_S = 5.0, 1000.0
_SOAKED_S = 20 * 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Wall time of one main job: of the campaign alone, and of the whole command, which fits and reports too."""

    run_s: float
    command_s: float


STATED = Job(run_s=33.0, command_s=40.0)
"""By that README, of two quiet cores of an Intel Xeon."""


def measured() -> list[Comparison]:
    """The main job, and both kinds of bench time with and without wires."""
    before, ours, theirs = measured_jobs()
    samples, without = alternating(lambda: streamed(wires=True), lambda: streamed(wires=False), _TURNS)
    soaked, unwired = alternating(lambda: soaking(wires=True), lambda: soaking(wires=False), _TURNS)
    bare = "without wires"
    return [
        Comparison("main job, the run", ours.run_s, "s", before, theirs.run_s, "<=", HALF),
        Comparison("main job, with fit and report", ours.command_s, "s", before, theirs.command_s, "<=", HALF),
        Comparison("simulated stream", samples, "samples a second", bare, without, ">=", OF_ITS_PHYSICS),
        Comparison("simulated soak", soaked, "bench hours a second", bare, unwired, ">=", OF_ITS_PHYSICS_IN_A_SOAK),
    ]


def measured_jobs() -> tuple[str, Job, Job]:
    """What the main job is compared with, ours, and what it is compared with."""
    with _version(BEFORE) as earlier:
        if earlier is None:
            return "as stated, on an Intel Xeon", _median([main_job(ROOT) for _ in range(_JOBS)]), STATED
        turns = [(main_job(ROOT), main_job(earlier)) for _ in range(_JOBS)]
    ours, theirs = zip(*turns, strict=True)
    return f"the version before, {BEFORE}", _median(ours), _median(theirs)


@contextmanager
def _version(commit: str) -> Iterator[Path | None]:
    """The code as it stood at a commit, in a folder for the while; None where the repository has no such history."""
    with tempfile.TemporaryDirectory() as folder:
        cloned = ("git", "clone", "--quiet", "--shared", "--no-checkout", str(ROOT), folder)
        try:
            for command in (cloned, ("git", "-C", folder, "checkout", "--quiet", commit)):
                subprocess.run(command, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            yield None
            return
        yield Path(folder)


def _median(jobs: Sequence[Job]) -> Job:
    run_s, command_s = (statistics.median(times) for times in zip(*((j.run_s, j.command_s) for j in jobs), strict=True))
    return Job(run_s=run_s, command_s=command_s)


def main_job(code: Path) -> Job:
    """The command of the README's first lines, by the code of a folder, into another one that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "run.json"
        job = (
            "run",
            str(code / "procedures" / "two_stage.py"),  # by its path: the name is that of the installed version
            "--bench",
            "simulated",
            "--out",
            f"{folder}/campaign",
            "--json",
            str(told),
            "--quiet",
        )
        began_s = time.perf_counter()
        here = {**os.environ, "PYTHONPATH": str(code)}
        subprocess.run((sys.executable, "-m", "benchctl", *job), check=True, capture_output=True, cwd=code, env=here)
        command_s = time.perf_counter() - began_s
        return Job(run_s=json.loads(told.read_text())["wall_time_s"], command_s=command_s)


def streamed(*, wires: bool) -> float:
    """Scans a second of wall time, encoder, gyro and thermistor each, of a table that turns, as fast as they come."""
    with open_bench(load_bench("simulated"), wires=wires) as opened:
        opened.table.enable()
        opened.table.go_to_rate(100.0)
        start = opened.digitizer.start_stream(opened.bench.digitizer.sample_rate_hz)
        a_chunk = int(_CHUNK_S * start.rate_hz)
        behind = a_chunk // 10  # what may wait in a packet that is not full yet
        scans = 0
        began_s = time.perf_counter()
        for chunk in range(1, round(_STREAMED_S / _CHUNK_S) + 1):
            opened.clock.sleep(_CHUNK_S)
            while scans < chunk * a_chunk - behind:
                scans += len(opened.digitizer.read_stream(chunk * a_chunk - behind - scans, timeout_s=10.0).gyro_v)
        took_s = time.perf_counter() - began_s
        opened.digitizer.stop_stream()
        opened.table.stop()
    return scans / took_s


def soaking(*, wires: bool) -> float:
    """Hours of bench time a second of wall time of a campaign that soaks, with all looks at the bench, and records."""
    plan = api.plan("static", soak_s=_SOAKED_S, duration_s=10.0)
    with tempfile.TemporaryDirectory() as folder:
        watch, campaign = Watch(warn=_no_warning), Path(folder) / "campaign"
        outcome = play(plan, load_bench("simulated"), campaign, watch=watch, wires=wires)
    if outcome.status != "complete":
        raise RuntimeError(f"the soak ended early: {outcome.error}")
    return outcome.bench_time_s / 3600.0 / outcome.wall_time_s


def _no_warning(says: str) -> None:
    raise RuntimeError(f"nothing should have been warned of: {says}")
