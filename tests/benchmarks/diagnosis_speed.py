"""One diagnosis, from the command to its JSON, beside limits of time and memory; what more rows and effects cost.

    python -m tests.benchmarks.diagnosis_speed --curve [--most ROWS]

prints the cost against rows, 10⁵ to `--most` (default 10⁷), and against the number of effects that are concealed. Each
recording is simulated without the wire into a folder that is removed; each diagnosis is `benchctl diagnose` in a
process of its own, whose seconds and largest memory are those of the whole process, imports and reading included.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchctl_instruments.errors import UsageError
from tests.benchctl.believed import BELIEVED, NO_ENCODER_ERRORS
from tests.benchmarks.comparison import Comparison

ROWS, LIMIT_S = 400_000, 10.0
MANY_ROWS, MANY_LIMIT_S = 10_000_000, 120.0
LIMIT_GIB = 16.0
WELL_UNDER = 0.75
_TURNS = 3
_CURVE = (100_000, 400_000, 1_000_000, 3_000_000, 10_000_000, 30_000_000, 100_000_000)

_RATE_HZ = 125.0
_RAMP_S_PER_C = 30.0
_ROWS_AT_A_SET_POINT = 18_125
_SWINGS_C = (45.0, 0.0, 23.0)
"""Set points that a campaign goes round after 23 °C."""

EFFECTS: Mapping[str, Mapping[str, float]] = {
    "thermal_lag": {"tau_s": 312.0},
    "scale_asymmetry": {"fraction": 4e-4},
    "bias_temperature_rate": {"v_per_c_per_s": 0.05},
    "heading_dependent_bias": {"amplitude_v": 6e-4, "phase_deg": 40.0, "order": 1.0},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """What a diagnosis took, and what it named."""

    rows: int
    seconds: float
    gib: float
    named: tuple[str, ...]


def measured() -> list[Comparison]:
    """Seconds for 400,000 rows, median of three, and for 10⁷, and the memory of that; one effect is concealed."""
    with tempfile.TemporaryDirectory() as folder:
        recording, rows = recorded(Path(folder), ROWS, ("thermal_lag",))
        usual = [diagnosed(recording, rows) for _ in range(_TURNS)]
        recording, rows = recorded(Path(folder), MANY_ROWS, ("thermal_lag",))
        many = diagnosed(recording, rows)
    seconds = statistics.median(one.seconds for one in usual)
    return [
        Comparison(f"one diagnosis, {usual[0].rows:,} rows", seconds, "s", "limit", LIMIT_S, "<=", 1.0),
        Comparison(f"one diagnosis, {many.rows:,} rows", many.seconds, "s", "limit", MANY_LIMIT_S, "<=", 1.0),
        Comparison(f"its memory, {many.rows:,} rows", many.gib, "GiB", "limit", LIMIT_GIB, "<=", WELL_UNDER),
    ]


def recorded(folder: Path, rows: int, effects: Sequence[str]) -> tuple[Path, int]:
    """Simulate a campaign of about so many rows that obeys some effects; the recording, and how many rows it has."""
    lab = folder / "lab"
    if not lab.exists():
        _benchctl("init", str(lab))
    bench = lab / "bench.toml"
    exact = {"sample_rate_hz": _RATE_HZ, "encoder_counts_per_rev": 3_600_000, "encoder_accuracy_arcsec": 0.0}
    lines = bench.read_text(encoding="utf-8").splitlines()
    told = [next((f"{name} = {value}" for name, value in exact.items() if one.startswith(name)), one) for one in lines]
    bench.write_text("\n".join(told) + "\n", encoding="utf-8")
    model, recording, summary = folder / "obeyed.toml", folder / f"{rows}-{len(effects)}.h5", folder / "simulated.json"
    tables = [
        f"[effects.{name}]\n" + "".join(f"{key} = {EFFECTS[name][key]}\n" for key in EFFECTS[name]) for name in effects
    ]
    model.write_text(BELIEVED + NO_ENCODER_ERRORS + "".join(tables), encoding="utf-8")
    points = ",".join(f"{one:g}" for one in set_points_c(rows))
    what = ("diagnostic", "--bench", str(bench), "--model", str(model), "-p", f"set_points_c={points}")
    _benchctl("simulate", *what, "-o", str(recording), "--seed", "7", "--json", str(summary), "--quiet")
    return recording, int(json.loads(summary.read_text(encoding="utf-8"))["samples"])


def set_points_c(rows: int) -> list[float]:
    """Set points between which the ramps, and at which the steps, make about so many rows."""
    points, made = [23.0], float(_ROWS_AT_A_SET_POINT)
    while True:
        goes_to = _SWINGS_C[(len(points) - 1) % len(_SWINGS_C)]
        ramp = abs(goes_to - points[-1]) * _RAMP_S_PER_C * _RATE_HZ
        left = rows - made - _ROWS_AT_A_SET_POINT
        if left < ramp:
            away = max(left, 0.0) / (_RAMP_S_PER_C * _RATE_HZ)
            return [*points, points[-1] + max(away, 2.0) * (1.0 if goes_to > points[-1] else -1.0)]
        points.append(goes_to)
        made += ramp + _ROWS_AT_A_SET_POINT


def diagnosed(recording: Path, rows: int) -> Taken:
    """One `benchctl diagnose` in a process of its own."""
    told = recording.with_suffix(".json")
    began_s = time.perf_counter()
    process = _started("diagnose", str(recording), "--json", str(told), "--quiet")
    error = process.stderr.read() if process.stderr else b""
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - began_s
    if process.returncode:
        raise UsageError(f"benchctl diagnose {recording.name} failed: {_last_line(error)}")
    said = json.loads(told.read_text(encoding="utf-8"))
    unit = 1 if sys.platform == "darwin" else 1024
    named = tuple(one["effect"] for one in said["findings"])
    return Taken(rows=rows, seconds=seconds, gib=used.ru_maxrss * unit / 2**30, named=named)


def _started(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "benchctl", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def _benchctl(*arguments: str) -> None:
    """Raises `UsageError` where the command fails."""
    process = _started(*arguments)
    _, error = process.communicate()
    if process.returncode:
        raise UsageError(f"benchctl {arguments[0]} failed: {_last_line(error)}")


def _last_line(error: bytes) -> str:
    return (error.decode(errors="replace").strip().splitlines() or ["it said nothing"])[-1]


def _curve(most: int) -> None:
    print("against rows, one effect concealed:")  # noqa: T201
    with tempfile.TemporaryDirectory() as folder:
        for rows in (rows for rows in _CURVE if rows <= most):
            recording, true_rows = recorded(Path(folder), rows, ("thermal_lag",))
            _print(diagnosed(recording, true_rows))
            recording.unlink()
        print(f"against effects, {ROWS:,} rows:")  # noqa: T201
        for count in range(len(EFFECTS) + 1):
            recording, true_rows = recorded(Path(folder), ROWS, tuple(EFFECTS)[:count])
            _print(diagnosed(recording, true_rows))


def _print(taken: Taken) -> None:
    named = ", ".join(taken.named) or "nothing"
    print(f"{taken.rows:>12,} rows {taken.seconds:8.1f} s {taken.gib:7.2f} GiB  {named}", flush=True)  # noqa: T201


def main(arguments: Sequence[str]) -> int:
    """The curves, or the figures of the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.diagnosis_speed")
    parser.add_argument("--curve", action="store_true", help="print the cost against rows and against effects")
    parser.add_argument("--most", type=int, default=MANY_ROWS, metavar="ROWS", help="where the curve ends")
    asked = parser.parse_args(arguments)
    if asked.curve:
        _curve(asked.most)
    else:
        print(json.dumps([one.as_json() for one in measured()], indent=1))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
