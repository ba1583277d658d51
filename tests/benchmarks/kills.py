"""What a killed run loses: `python -m tests.benchmarks.kills --campaigns 200 --to kills.jsonl`.

Each campaign is three real processes: the simulated bench (`benchctl sim`), a run on it that gets SIGKILL at a random
moment, and, once a foreign client has read the table at rest and the chamber safe, `run --resume --yes`. What the
killed run had recorded is opened by a process of its own in between. A line of JSON a campaign goes to `--to`, and
campaigns that are there are not run again, so that it may be stopped at any time; the table is printed from all lines.
A campaign mostly waits for its bench's clock: `--jobs` of them run at once, each with a bench and a guard of its own.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from tests.benchctl.cli.foreign_eyes import ForeignEyes

PROCEDURE = '''
from benchctl.plan import ConstantRate, Soak, Static, procedure

@procedure(calibrates=True)
def kills():
    """Rates in both directions between zeros, at the temperature at which the bench stands."""
    yield Soak(setpoint_c=23.0, hold_s=20.0)
    yield Static(duration_s=15.0)
    for rate in (40.0, 80.0, 120.0, 160.0):
        for sign in (1.0, -1.0):
            yield ConstantRate(rate_dps=sign * rate, duration_s=18.0, role="verify" if rate == 80.0 else "fit")
    yield Static(duration_s=15.0)
'''
PLANNED = 11
PARAMETERS = ("K0_v_per_dps", "S_rad_per_dps", "U0_v")
SAFE_C = 23.0
AT_REST_DPS = 0.05
SAFE_WITHIN_S = 30.0
TIMEOUT_S = 300.0


def main() -> None:
    """Run what is not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--to", type=Path, default=Path("kills.jsonl"), help="a line of JSON a campaign")
    parser.add_argument("--jobs", type=int, default=3, help="campaigns at once")
    parser.add_argument("--speed", type=float, default=20.0, help="bench seconds a wall second")
    arguments = parser.parse_args()
    trials = read(arguments.to)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(arguments.jobs) as at_once:
        if not trials:  # number 0 is not killed: the others are held against it
            keep(run_trial(0, Path(folder), arguments.speed, None), trials, arguments.to)
        there = {trial["number"] for trial in trials}
        missing = [number for number in range(1, arguments.campaigns + 1) if number not in there]
        running = [at_once.submit(run_trial, number, Path(folder), arguments.speed, trials[0]) for number in missing]
        for ended in as_completed(running):
            keep(ended.result(), trials, arguments.to)
    print(table(trials))  # noqa: T201


def keep(trial: dict[str, Any], trials: list[dict[str, Any]], path: Path) -> None:
    """Add a campaign to those that are there, in memory and in the file."""
    trials.append(trial)
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(trial) + "\n")


def read(path: Path) -> list[dict[str, Any]]:
    """The campaigns that are there; a line that was torn is not."""
    trials = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            trials.append(json.loads(line))
        except ValueError:
            continue
    return sorted(trials, key=lambda trial: int(trial["number"]))


def run_trial(number: int, folder: Path, speed: float, straight: dict[str, Any] | None) -> dict[str, Any]:
    """One campaign: run it, kill it once somewhere in the time that `straight`, the one without a kill, took."""
    place = folder / str(number)
    place.mkdir()
    (place / "kills.py").write_text(PROCEDURE, encoding="utf-8")
    trial: dict[str, Any] = {"number": number}
    with _bench(place, speed) as eyes:
        began_s = time.monotonic()
        if straight is not None:
            trial |= _kill(place, eyes, random.Random(number).uniform(0.3, 0.95 * straight["took_s"]))
        begun = _is_begun(place / "c")
        resume = ("--resume", "c", "--yes") if begun else ("--out", "d")
        ended = _benchctl(place, "run", "kills.py", "--bench", "bench.toml", *resume, "--json", "run.json", "-q")
        trial |= {"took_s": time.monotonic() - began_s, "resumed": resume[0] == "--resume"}
    told = json.loads((place / "run.json").read_text())
    trial |= {"exit": ended.returncode, "said": ended.stderr.strip(), "complete": told.get("status") == "complete"}
    if told.get("coefficients"):
        found = json.loads((place / told["coefficients"]).read_text())["uncertainty"]["parameters"]
        trial["coefficients"] = {name: [found[name]["value"], *found[name]["ci95"]] for name in PARAMETERS}
        trial["verified"] = _benchctl(place, "verify", told["recording"]).returncode == 0
    shutil.rmtree(place)
    return trial


@contextmanager
def _bench(place: Path, speed: float) -> Iterator[ForeignEyes]:
    command = _command("sim", "--bench", "simulated", "--speed", str(speed), "--write-bench", "bench.toml")
    with subprocess.Popen(command, cwd=place, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        with ForeignEyes(json.loads(process.stdout.readline())) as eyes:
            yield eyes
        process.terminate()


def _kill(place: Path, eyes: ForeignEyes, after_s: float) -> dict[str, Any]:
    """Run the campaign, kill it, see how the bench comes to rest, and what a fresh process finds in the folder."""
    with subprocess.Popen(
        _command("run", "kills.py", "--bench", "bench.toml", "--out", "c", "-q"), cwd=place, stderr=subprocess.DEVNULL
    ) as process:
        try:
            process.wait(after_s)
        except subprocess.TimeoutExpired:
            process.kill()
        killed_s, killed = time.monotonic(), datetime.now().astimezone()
    trial: dict[str, Any] = {"killed": process.returncode != 0, "after_s": after_s, "moving_dps": eyes.rate_dps()}
    trial["safe_s"] = _safe_after_s(eyes, killed_s)
    if not _is_begun(place / "c"):
        return trial | {"begun": False}
    shown = _benchctl(place, "show", "c", "--json", "show.json", "-q")
    trial |= {"begun": True, "opens": shown.returncode == 0}
    if shown.returncode == 0:
        document = json.loads((place / "show.json").read_text())
        trial |= {"status": document["status"], **_lost(place / "c", document["steps"], killed)}
    return trial


def _is_begun(campaign: Path) -> bool:
    return any((campaign / name).exists() for name in ("campaign.h5", "recording.h5"))


def _safe_after_s(eyes: ForeignEyes, killed_s: float) -> float | None:
    """When, since the kill, the table was read at rest and the chamber at its safe set point; None: not in time."""
    while (passed_s := time.monotonic() - killed_s) < SAFE_WITHIN_S:
        if abs(eyes.rate_dps()) < AT_REST_DPS and abs(eyes.chamber_setpoint_c() - SAFE_C) < 0.05:
            return passed_s
        time.sleep(0.02)
    return None


def _lost(campaign: Path, steps: Sequence[dict[str, Any]], killed: datetime) -> dict[str, Any]:
    """Steps that the journal says are whole and that are not there; wall time of samples that no file has."""
    text = (campaign / "journal.jsonl").read_text(encoding="utf-8")
    events = [json.loads(line) for line in text.split("\n")[:-1] if line.startswith("{")]
    told = {event["index"] for event in events if event["kind"] == "whole"}
    whole = {step["index"] for step in steps if step["whole"]}
    timed = [event for event in events if "bench_s" in event]
    part = next((step for step in steps if not step["whole"] and step["samples"]), None)
    lost_s = None
    if part is not None and timed:
        first, last = timed[0], timed[-1]
        passed_s = _wall(last) - _wall(first)
        factor = (last["bench_s"] - first["bench_s"]) / passed_s if passed_s > 0 else math.nan
        lost_s = killed.timestamp() - _wall(last) - (part["t_end"] - last["bench_s"]) / factor
    return {"whole": len(whole), "told": len(told), "steps_lost": len(told - whole), "samples_lost_s": lost_s}


def _wall(event: dict[str, Any]) -> float:
    return datetime.fromisoformat(event["wall_time"]).timestamp()


def table(trials: Sequence[dict[str, Any]]) -> str:
    """All campaigns summed up, as Markdown."""
    straight, killed = trials[0], [trial for trial in trials[1:] if trial["killed"]]
    begun = [trial for trial in killed if trial["begun"]]
    lost_s = [trial["samples_lost_s"] for trial in begun if trial.get("samples_lost_s") is not None]
    safe_s = [trial["safe_s"] for trial in killed]
    in_time = [seconds for seconds in safe_s if seconds is not None]
    agree = [
        _agrees(trial["coefficients"], straight["coefficients"], name)
        for trial in killed
        if "coefficients" in trial
        for name in PARAMETERS
    ]
    rows = [
        ("campaigns killed", f"{len(killed)}, {len(killed) - len(begun)} of them before anything was recorded"),
        ("moved when they were killed", f"{sum(abs(trial['moving_dps']) > AT_REST_DPS for trial in killed)}"),
        ("opened by a fresh process", f"{sum(trial['opens'] for trial in begun)} of {len(begun)}"),
        (
            "said to be aborted or complete",
            f"{sum(trial.get('status') in ('aborted', 'complete') for trial in begun)} of {len(begun)}",
        ),
        (
            "whole steps lost",
            f"{sum(trial.get('steps_lost', 0) for trial in begun)} of {sum(trial.get('told', 0) for trial in begun)}",
        ),
        ("samples lost, wall time: median, most", f"{_spread(lost_s)} (of {len(lost_s)} killed in a stream)"),
        (
            "table at rest and chamber safe: median, most",
            f"{_spread(in_time)} ({len(in_time)} of {len(safe_s)} within {SAFE_WITHIN_S:g} s)",
        ),
        ("complete after `--resume`", f"{sum(trial['complete'] for trial in begun)} of {len(begun)}"),
        ("digests hold", f"{sum(trial.get('verified', False) for trial in begun)} of {len(begun)}"),
        ("coefficients as of the uninterrupted one, by both 95 % intervals", f"{sum(agree)} of {len(agree)}"),
    ]
    return "\n".join(["| what | figure |", "|---|---|", *(f"| {what} | {figure} |" for what, figure in rows)])


def _agrees(ours: dict[str, list[float]], theirs: dict[str, list[float]], name: str) -> bool:
    (value, low, high), (other, other_low, other_high) = ours[name], theirs[name]
    return abs(value - other) <= math.hypot((high - low) / 2, (other_high - other_low) / 2)


def _spread(seconds: Sequence[float]) -> str:
    return f"{statistics.median(seconds):.2f} s, {max(seconds):.2f} s" if seconds else "none"


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "benchctl", *arguments]


def _benchctl(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(_command(*arguments), cwd=place, capture_output=True, text=True, timeout=TIMEOUT_S)


if __name__ == "__main__":
    main()
