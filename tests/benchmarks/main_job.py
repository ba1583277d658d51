"""The main job and the start of the command line against their limits: `python -m tests.benchmarks.main_job`."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

WALL_LIMIT_S = 120.0
MEMORY_LIMIT_BYTES = 2**30
HELP_LIMIT_S = 0.2


def wall_s(*command: str) -> float:
    """How long a command takes."""
    began_s = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - began_s


def children_peak_bytes() -> int | None:
    """The largest memory that any command so far has held; None where the system does not say."""
    if sys.platform == "win32":
        return None
    import resource

    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024


def main() -> None:
    """Print each figure beside its limit, as a ratio."""
    python = sys.executable
    bare_s = statistics.median(wall_s(python, "-c", "pass") for _ in range(9))
    help_s = statistics.median(wall_s(python, "-m", "benchctl", "--help") for _ in range(9))
    print(f"--help {help_s:.3f} s, bare Python {bare_s:.3f} s: {help_s / HELP_LIMIT_S:.2f} of {HELP_LIMIT_S} s")  # noqa: T201
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "run.json"
        campaign = str(Path(folder) / "campaign")
        job = ("run", "two_stage", "--bench", "simulated", "--out", campaign, "--json", str(result), "--quiet")
        took_s = wall_s(python, "-m", "benchctl", *job)
        told = json.loads(result.read_text())
    print(  # noqa: T201
        f"main job {took_s:.1f} s with the fit, {told['samples']:,} samples, "
        f"{told['bench_time_s'] / 3600:.1f} bench hours: {took_s / WALL_LIMIT_S:.2f} of {WALL_LIMIT_S:g} s"
    )
    if (peak := children_peak_bytes()) is not None:
        print(f"peak memory {peak / 2**20:.0f} MiB: {peak / MEMORY_LIMIT_BYTES:.2f} of 1 GiB")  # noqa: T201


if __name__ == "__main__":
    main()
