"""Hands jobs to a cluster and takes their outcomes, whichever workers come and go meanwhile."""

from __future__ import annotations

import time
import uuid
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

import benchctl
from benchctl.campaign.stop import StopRequest
from benchctl.fleet.job import Job, Outcome
from benchctl.fleet.work import MOST_STARTS, starts_of, work
from benchctl_instruments.errors import BenchError, LinkError, in_line

_LOOK_S = 0.02
_AHEAD = 256
"""Jobs that are handed over at once, or two for each thread of a larger cluster."""
_DONE_AGAIN = ("lost", "pending")
"""Of a job that had ended: its worker died before the outcome was taken from it, and the cluster asks another one."""


def outcomes(client: Any, jobs: Sequence[Job], stop: StopRequest) -> Iterator[tuple[Job, Outcome]]:
    """Do jobs, the largest recordings first, on the cluster of a client of dask's; each with its outcome, as it ends.

    Raises
    ------
    StoppedError
        Where a stop was asked for; what was not begun is called off then.
    LinkError
        Where the scheduler is gone, or has let go of the jobs; workers finish what they are at.
    """
    from distributed import as_completed

    waiting = deque(sorted(jobs, key=lambda job: -job.recording.size))
    given: dict[str, Job] = {}
    ended = as_completed()
    ahead = max(_AHEAD, 2 * sum(client.nthreads().values()))
    futures: dict[str, Any] = {}
    try:
        while waiting or given:
            while waiting and len(given) < ahead:
                job = waiting.popleft()
                future = client.submit(work, job, benchctl.__version__, key=f"{job.verb}-{uuid.uuid4().hex}")
                given[future.key], futures[future.key] = job, future
                ended.add(future)
            stop.heed()
            if not ended.has_ready():
                time.sleep(_LOOK_S)
                continue
            for future in ended.next_batch(block=False):
                status = future.status
                if status in _DONE_AGAIN:
                    ended.add(future)
                    continue
                outcome = _outcome_of(future, status, given[future.key])
                del futures[future.key]
                job = given.pop(future.key)
                if outcome is None:
                    waiting.append(job)
                else:
                    yield job, outcome
    except (OSError, CancelledError) as err:
        futures.clear()  # there is nobody to call them off
        raise LinkError(
            f"scheduler {client.scheduler.address}: is gone, or was restarted; the same command goes on"
        ) from err
    finally:
        if futures:
            client.cancel(list(futures.values()), force=True)


def _outcome_of(future: Any, status: str, job: Job) -> Outcome | None:
    """How a job ended whose future has this status; None where a scheduler gave it up whose workers died, not of it.

    Raises `OSError` or `CancelledError` where the scheduler is gone.
    """
    from distributed.scheduler import KilledWorker

    if status == "finished":
        outcome: Outcome = future.result()
        return outcome
    if status != "error":
        raise CancelledError
    error = future.exception()
    if isinstance(error, KilledWorker) and _starts(job) < MOST_STARTS:
        return None
    return Outcome(
        state="failed",
        says=f"{job.recording.where}: the worker could not do it: {type(error).__name__}: {in_line(str(error))}",
    )


def _starts(job: Job) -> int:
    """How many workers died of a job; as many as may, where that cannot be told."""
    try:
        return len(starts_of(job))
    except BenchError:
        return MOST_STARTS
