"""Workers killed by SIGKILL while they work, under a scheduler and workers that were started by hand."""

from __future__ import annotations

import json
import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.benchctl.cli.processes import benchctl, started
from tests.benchctl.fleet.clusters import LONGEST_S, dask_cluster
from tests.benchctl.fleet.made import points

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@contextmanager
def killing(note: Path, times: int) -> Iterator[set[int]]:
    """Kill the worker that says in the note that it is at work, each process once, so many of them."""
    killed: set[int] = set()
    over = threading.Event()

    def watch() -> None:
        while not over.is_set() and len(killed) < times:
            try:
                process = int(note.read_text().splitlines()[-1].split()[2])
            except (OSError, IndexError):
                time.sleep(0.01)
                continue
            if process not in killed:
                killed.add(process)
                os.kill(process, signal.SIGKILL)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield killed
    finally:
        over.set()
        thread.join()


def fit_of(folder: Path, *arguments: str) -> dict[str, object]:
    ran = benchctl(
        "fleet", "fit", f"{folder}/*.h5", "--report", folder, "--json", "-", *arguments, timeout_s=LONGEST_S * 3
    )
    assert "Traceback" not in ran.stderr
    told: dict[str, object] = json.loads(ran.stdout)
    assert told["ok"] == (ran.returncode == 0), ran.stderr
    return told


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Six units."""
    for number in range(6):
        points(tmp_path / "units" / f"u{number}.h5", number)
    return tmp_path / "units"


def test_a_worker_that_is_killed_at_work_loses_nothing(folder: Path) -> None:
    with killing(folder / ".u3.fit.begun", times=1) as killed:
        told = fit_of(folder, "--workers", "2")
    assert len(killed) == 1
    assert told["recordings"] == {"total": 6, "done": 6, "kept": 0, "failed": 0, "left": 0}
    assert len(list(folder.glob("*.fit/coefficients.json"))) == 6
    assert not list(folder.glob(".*"))


def test_what_kills_its_worker_twice_is_reported_and_does_not_stop_the_rest(tmp_path: Path, folder: Path) -> None:
    with dask_cluster(tmp_path, workers=2) as (address, _), killing(folder / ".u3.fit.begun", times=9) as killed:
        told = fit_of(folder, "--scheduler", address)
    assert len(killed) == 2
    assert told["recordings"] == {"total": 6, "done": 5, "kept": 0, "failed": 1, "left": 0}
    (failure,) = told["failures"]  # type: ignore[misc]  # a list
    assert failure["recording"] == str(folder / "u3.h5")
    assert "2 workers died of it" in failure["says"]
    again = fit_of(folder)
    assert again["recordings"] == {"total": 6, "done": 1, "kept": 5, "failed": 0, "left": 0}


def test_a_scheduler_that_is_killed_ends_the_fleet_and_the_same_command_goes_on(tmp_path: Path, folder: Path) -> None:
    with (
        dask_cluster(tmp_path, workers=1) as (address, scheduler),
        started("fleet", "fit", f"{folder}/*.h5", "--report", folder, "--scheduler", address) as process,
    ):
        while not list(folder.glob("*.fit")):
            assert process.poll() is None
            time.sleep(0.02)
        scheduler.kill()
        out, err = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 2
    *_, says = err.splitlines()  # the worker may have been waited for before
    assert says == f"benchctl: scheduler {address}: is gone, or was restarted; the same command goes on"
    left = int(re.findall(r", 0 failed, (\d) left$", out.splitlines()[0])[0])
    again = fit_of(folder)["recordings"]
    possible = range(min(left, 5) + 1)  # what had landed is not always told yet, and a worker ends what it is at
    assert again in [{"total": 6, "done": done, "kept": 6 - done, "failed": 0, "left": 0} for done in possible]
