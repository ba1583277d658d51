"""The whole fit of a recording of 10⁸ scans beside the reading of the same four columns with h5py, and its memory.

Ours is `api.fit`: opening, reading, the digests of all samples, both stages, the joint fits, the errors on runs kept
aside. h5py's is a loop over all steps that reads `time_s`, `encoder_deg`, `gyro_v` and `gyro_temp_c`, a MiB at a time,
in one thread, and does nothing with them. Each is a process of its own, timed from when its modules are loaded; the
memory is the largest that the process of the fit ever held. The file lies in the system's cache for both.
"""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchctl_instruments.errors import UsageError
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.large_campaign import write_campaign
from tests.benchmarks.memory import peak_bytes

SCANS = 1e8
TIMES_THE_READING = 1.5
LIMIT_MIB = 500.0
_TURNS = 3
_AT_ONCE = 1 << 17

Taken = tuple[float, float]
"""Seconds, and the largest memory of the process, MiB."""


def measured() -> list[Comparison]:
    """Time of the fit beside that of reading, and its memory beside the limit."""
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "large.h5"
        write_campaign(recording, SCANS)
        pairs = [(_in_a_process("fit", recording), _in_a_process("read", recording)) for _ in range(_TURNS)]
    fit_s, read_s = (statistics.median(pair[column][0] for pair in pairs) for column in range(2))
    most_mib = max(fit[1] for fit, _ in pairs)
    name = f"two-stage fit of {SCANS:.0e} scans"
    return [
        Comparison(name, fit_s, "s", "h5py reading its columns", read_s, "<=", TIMES_THE_READING),
        Comparison(f"{name}, memory", most_mib, "MiB", "limit", LIMIT_MIB, "<=", 1.0),
    ]


def _in_a_process(work: str, recording: Path) -> Taken:
    """Raises `UsageError` where the work fails."""
    command = (sys.executable, "-m", __name__, work, str(recording))
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise UsageError(f"{work} of {recording} failed: {done.stderr.strip().splitlines()[-1]}")
    seconds, mib = json.loads(done.stdout)
    return seconds, mib


def _fit(recording: Path) -> Callable[[], object]:
    from benchctl import api

    return lambda: api.fit(recording)


def _read(recording: Path) -> Callable[[], object]:
    import h5py

    def read() -> None:
        with h5py.File(recording) as file:
            for step in file["steps"].values():
                for name in ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c"):
                    for start in range(0, len(step[name]), _AT_ONCE):
                        step[name][start : start + _AT_ONCE]

    return read


if __name__ == "__main__":
    loaded = {"fit": _fit, "read": _read}[sys.argv[1]](Path(sys.argv[2]))
    began_s = time.perf_counter()
    loaded()
    print(json.dumps([time.perf_counter() - began_s, (peak_bytes() or math.nan) / 2**20]))  # noqa: T201
