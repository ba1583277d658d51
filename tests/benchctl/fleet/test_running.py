"""Jobs on a cluster whose workers die between ending a job and being asked what came of it."""

from __future__ import annotations

import os
import signal
from multiprocessing.resource_tracker import ensure_running
from pathlib import Path
from typing import Any

import pytest

from benchctl.campaign.stop import StopRequest
from benchctl.fleet.cluster import connected, outcomes
from benchctl_instruments.errors import UsageError
from tests.benchctl.fleet.clusters import LONGEST_S, dask_cluster
from tests.benchctl.fleet.made import job_of, points
from tests.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


class _KillsBeforeTheOutcomeIsTaken(StopRequest):
    """Looked at between two looks at the jobs: kills the worker that has ended one, until the cluster misses it."""

    def __init__(self, client: Any, results: Path) -> None:
        super().__init__()
        self.client, self.results, self.landed_ns = client, results, 0

    def heed(self) -> None:
        if self.landed_ns:
            return
        wait_until(lambda: self.results.exists() and "finished" in self._statuses(), LONGEST_S)
        for process in self.client.run(os.getpid).values():
            os.kill(process, signal.SIGKILL)
        self.landed_ns = self.results.stat().st_mtime_ns
        wait_until(lambda: "lost" in self._statuses(), LONGEST_S)

    def _statuses(self) -> set[str]:
        return {state.status for state in self.client.futures.values()}


def test_an_outcome_that_died_with_its_worker_is_asked_of_another_one_and_the_job_is_not_done_again(
    tmp_path: Path,
) -> None:
    path = points(tmp_path / "units" / "u0.h5", 0)
    job = job_of(path)
    results = tmp_path / "units" / "u0.fit" / "coefficients.json"
    with dask_cluster(tmp_path, workers=1) as (address, _), connected(address, 1) as client:
        stop = _KillsBeforeTheOutcomeIsTaken(client, results)
        ended = [(one, outcome.state, outcome.reason) for one, outcome in outcomes(client, [job], stop)]
    assert ended == [(job, "done", "")]
    assert results.stat().st_mtime_ns == stop.landed_ns > 0


def test_processes_that_cannot_be_started_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    ensure_running()  # the process that watches semaphores is started by the same executable
    monkeypatch.setattr("multiprocessing.spawn._python_exe", b"/bin/false")
    with (
        pytest.raises(UsageError, match=r"1 worker processes cannot be started here: .*; check the limits on memory"),
        connected(None, 1),
    ):
        pass
