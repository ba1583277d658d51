"""The simulated bench: the main job against what it took before, and what its wires cost beside its physics alone.

The main job is the command of the README's first lines: 328 steps, 20 set points, 33.5 h of bench time, every byte over
a socket. Wires and protocols are then measured apart from the rest: the same bench is streamed from, and soaked,
without any, by method calls, where only the same physics is computed, sample by sample the same.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchctl import api
from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.playing import play
from tests.benchmarks.comparison import Comparison, alternating

RUN_BEFORE_S, WITH_FIT_BEFORE_S = 33.0, 40.0
"""As the README of the main job's issue stated them, of two quiet cores of an Intel Xeon."""

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


def measured() -> list[Comparison]:
    """The main job, and both kinds of bench time with and without wires."""
    jobs = [main_job() for _ in range(_JOBS)]
    run_s = statistics.median(job.run_s for job in jobs)
    command_s = statistics.median(job.command_s for job in jobs)
    samples, without = alternating(lambda: streamed(wires=True), lambda: streamed(wires=False), _TURNS)
    soaked, unwired = alternating(lambda: soaking(wires=True), lambda: soaking(wires=False), _TURNS)
    before, bare = "the main job's issue", "without wires"
    return [
        Comparison("main job, the run", run_s, "s", before, RUN_BEFORE_S, "<=", HALF),
        Comparison("main job, with fit and report", command_s, "s", before, WITH_FIT_BEFORE_S, "<=", HALF),
        Comparison("simulated stream", samples, "samples a second", bare, without, ">=", OF_ITS_PHYSICS),
        Comparison("simulated soak", soaked, "bench hours a second", bare, unwired, ">=", OF_ITS_PHYSICS_IN_A_SOAK),
    ]


def main_job() -> Job:
    """The command of the README's first lines, into a folder that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "run.json"
        job = (
            "run",
            "two_stage",
            "--bench",
            "simulated",
            "--out",
            f"{folder}/campaign",
            "--json",
            str(told),
            "--quiet",
        )
        began_s = time.perf_counter()
        subprocess.run((sys.executable, "-m", "benchctl", *job), check=True, capture_output=True)
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
        outcome = play(plan, load_bench("simulated"), Path(folder) / "campaign", warn=_no_warning, wires=wires)
    if outcome.status != "complete":
        raise RuntimeError(f"the soak ended early: {outcome.error}")
    return outcome.bench_time_s / 3600.0 / outcome.wall_time_s


def _no_warning(says: str) -> None:
    raise RuntimeError(f"nothing should have been warned of: {says}")
