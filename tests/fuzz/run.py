"""Fuzzes every parser: `python -m tests.fuzz.run --inputs N [--only NAME] [--seconds S] [--keep FOLDER]`.

Each harness has a process of its own, with a limit of memory; an input that takes more than a second of processor time
counts as a crash. Prints a Markdown table. Ends with 1 where something crashed; its input is then in FOLDER. Deaths in
C, and what takes long there, are those of HDF5, which no parser can catch; their inputs are kept, too.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.fuzz.harness import clear_workplace, harness, harness_names

_MOST_CRASHES = 5
"""Of one harness; then it is given up."""
_FAULT_PREFIXES = ("crash-", "died-", "timeout-", "oom-", "slow-")


@dataclass(slots=True)
class Outcome:
    """What became of one harness."""

    name: str
    inputs: int = 0
    seconds: float = 0.0
    crashes: int = 0
    deaths: int = 0
    slow: int = 0
    slowest_s: float = 0.0
    peak_bytes: int = 0

    def row(self) -> str:
        """A row of the table."""
        rate = self.inputs / self.seconds if self.seconds else 0.0
        return (
            f"| {self.name} | {self.inputs:,} | {rate:,.0f} | {self.crashes} | {self.deaths} | {self.slow} "
            f"| {1e3 * self.slowest_s:.0f} ms | {self.peak_bytes / 1e6:.0f} MB |"
        )


def main() -> int:
    chosen = _arguments()
    if importlib.util.find_spec("atheris") is None:
        sys.stderr.write("atheris is not installed: pip install -e '.[fuzz]' (Linux and macOS; it brings libFuzzer)\n")
        return 2
    names = [chosen.only] if chosen.only else harness_names()
    _say("| parsers | inputs | inputs/s | crashes | deaths in C | over 1 s | slowest | peak memory |")
    _say("|---|---|---|---|---|---|---|---|")
    outcomes = []
    weights = {name: harness(name).weight for name in names}
    for name, weight in weights.items():
        inputs = -(-chosen.inputs * weight // sum(weights.values()))
        outcome = _fuzz(name, inputs, chosen.seconds, chosen.keep)
        _say(outcome.row())
        outcomes.append(outcome)
    total = Outcome(
        "all",
        inputs=sum(one.inputs for one in outcomes),
        seconds=sum(one.seconds for one in outcomes),
        crashes=sum(one.crashes for one in outcomes),
        deaths=sum(one.deaths for one in outcomes),
        slow=sum(one.slow for one in outcomes),
        slowest_s=max(one.slowest_s for one in outcomes),
        peak_bytes=max(one.peak_bytes for one in outcomes),
    )
    _say(total.row())
    _say(f"\n{platform.machine()}, {os.cpu_count()} CPUs, Python {platform.python_version()}, {platform.platform()}")
    return 1 if total.crashes else 0


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Fuzz every parser.")
    parser.add_argument("--inputs", type=int, required=True, help="inputs for all harnesses, split by their weights")
    parser.add_argument("--only", choices=harness_names(), help="one harness")
    parser.add_argument(
        "--seconds", type=int, default=0, help="at most so long for each harness; 0: as long as it takes"
    )
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "benchctl-fuzz", help="for crashes")
    return parser.parse_args()


def _fuzz(name: str, inputs: int, seconds: int, keep: Path) -> Outcome:
    """Run a harness until it has had its inputs or its time, or has crashed too often."""
    outcome = Outcome(name)
    begun = time.monotonic()
    while outcome.inputs < inputs and outcome.crashes < _MOST_CRASHES:
        left = seconds - int(time.monotonic() - begun) if seconds else 0
        if seconds and left <= 0:
            break
        with tempfile.TemporaryDirectory(prefix="benchctl-fuzz-") as scratch:
            crashed = _run(outcome, inputs - outcome.inputs, left, Path(scratch))
            _keep(Path(scratch), keep / name, crashed=crashed)
            if not crashed:
                break
            outcome.crashes += 1
    return outcome


def _run(outcome: Outcome, inputs: int, seconds: int, scratch: Path) -> bool:
    """One process after the other, as long as each ends because it was full; whether the last one crashed."""
    asked, begun = outcome.inputs + inputs, time.monotonic()
    while True:
        left = max(1, seconds - int(time.monotonic() - begun)) if seconds else 0
        told, crashed = _process(outcome, asked - outcome.inputs, left, scratch)
        is_over = outcome.inputs >= asked or 0 < seconds <= time.monotonic() - begun
        if crashed or is_over or not told.get("full"):
            return crashed


def _process(outcome: Outcome, inputs: int, seconds: int, scratch: Path) -> tuple[dict[str, Any], bool]:
    """One process; adds what it did to the outcome. Returns what it told, and whether it crashed."""
    (scratch / "told.json").unlink(missing_ok=True)
    log = scratch / "log.txt"
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "TMPDIR": str(scratch)}
    module = "isolated" if harness(outcome.name).native else "worker"
    arguments = [sys.executable, "-m", f"tests.fuzz.{module}", outcome.name, str(inputs), str(seconds), str(scratch)]
    with log.open("wb") as file:
        process = subprocess.Popen(arguments, stdout=file, stderr=file, env=environment)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    clear_workplace(process.pid)
    told: dict[str, Any] = json.loads((scratch / "told.json").read_text()) if (scratch / "told.json").exists() else {}
    outcome.inputs += told.get("inputs", 0)
    outcome.seconds += told.get("seconds", 0.0)
    outcome.crashes += told.get("crashes", 0)
    outcome.deaths += told.get("deaths", 0)
    outcome.slow += told.get("slow", 0)
    outcome.slowest_s = max(outcome.slowest_s, told.get("slowest_s", 0.0))
    outcome.peak_bytes = max(outcome.peak_bytes, used.ru_maxrss * (1 if sys.platform == "darwin" else 1024))
    return told, process.returncode != 0


def _keep(scratch: Path, kept: Path, *, crashed: bool) -> None:
    """Keep the inputs that crashed, and what was said of them."""
    found = [path for path in scratch.iterdir() if path.name.startswith(_FAULT_PREFIXES)]
    if not found and not crashed:
        return
    kept.mkdir(parents=True, exist_ok=True)
    for path in found:
        (kept / path.name).write_bytes(path.read_bytes())
    if crashed:
        name = found[0].name if found else "log"
        (kept / f"{name}.txt").write_text((scratch / "log.txt").read_text(errors="replace")[-6000:])


if __name__ == "__main__":
    sys.exit(main())
