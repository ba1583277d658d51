"""Workers killed by SIGKILL while they work, and a scheduler that was started by hand."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from benchctl.campaign.stop import StopRequest
from benchctl.fleet.cluster import connected, outcomes
from benchctl.fleet.job import JobOutcome
from benchctl.fleet.places import LocalPlace
from tests.benchctl.cli.processes import benchctl, started
from tests.benchctl.fleet.clusters import LONGEST_S, dask_cluster
from tests.benchctl.fleet.made import job_of, points

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@dataclass(frozen=True, slots=True)
class _Deadly(LocalPlace):
    """A folder of results that kills so many workers while they store them."""

    times: int

    def land(self, folder: Path, record: str, stale: set[str]) -> None:
        dead = Path(f"{self.where}.dead")
        died = len(dead.read_text()) if dead.exists() else 0
        if died < self.times:
            dead.write_text("x" * (died + 1))
            Path(self.where).mkdir(exist_ok=True)
            (Path(self.where) / "coefficients.json").write_text("{")
            os.kill(os.getpid(), signal.SIGKILL)
        LocalPlace.land(self, folder, record, stale)


def fitted_with_deaths(folder: Path, times: int) -> tuple[dict[str, JobOutcome], int]:
    """What comes of the units if the third one kills so many workers: outcomes by name, and how many it killed."""
    jobs = [job_of(path) for path in sorted(folder.glob("*.h5"))]
    jobs[3] = replace(jobs[3], place=_Deadly(jobs[3].place.where, times))
    with connected(None, 2) as client:
        ended = {job.recording.name: outcome for job, outcome in outcomes(client, jobs, StopRequest())}
    return ended, len((folder / "u3.fit.dead").read_text())


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
    ended, killed = fitted_with_deaths(folder, times=1)
    assert killed == 1
    assert {name: outcome.state for name, outcome in ended.items()} == {f"u{number}": "done" for number in range(6)}
    assert len([json.loads(path.read_bytes()) for path in folder.glob("*.fit/coefficients.json")]) == 6
    assert not list(folder.glob(".*"))


def test_what_kills_its_worker_twice_is_reported_and_does_not_stop_the_rest(folder: Path) -> None:
    ended, killed = fitted_with_deaths(folder, times=9)
    assert killed == 2
    assert {name for name, outcome in ended.items() if outcome.state == "done"} == {"u0", "u1", "u2", "u4", "u5"}
    assert ended["u3"].reason.startswith(f"{folder / 'u3.h5'}: 2 workers died of it: killed, out of memory")
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
