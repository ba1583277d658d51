"""Run a verb on many recordings, on a Dask cluster, and collect the results of each.

The cluster is an existing one, given by its scheduler's address, or new processes on this machine.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import time
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any

import benchctl
from benchctl.campaign.stop import StoppedError, StopRequest
from benchctl.fleet.job import Job, JobOutcome, JobRecord, Options, kept, record_at
from benchctl.fleet.located import Located
from benchctl.fleet.places import Place, place_of
from benchctl.fleet.work import work
from benchctl.reports.fleet_facts import Fleet, Member
from benchctl.reports.fleet_stated import REPORTS, VERBS, FleetVerb
from benchctl.side_by_side import cores
from benchctl_instruments.errors import BenchError, LinkError, UsageError, in_line

_CONNECT_S = 5.0

_SETTINGS = {
    "distributed.scheduler.allowed-failures": 1,  # the second worker that a job kills is its failure
    "distributed.scheduler.worker-saturation": 1.0,  # a job that is queued on a worker is lost with it
    "distributed.worker.profile.enabled": False,
    # dask runs these up to 50 times a second in every process, which costs 5 % of a fleet's time on two cores
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.comm.timeouts.connect": f"{_CONNECT_S:g}s",
}


def refuse_without_dask() -> None:
    """Raise `UsageError` if the extra is not installed."""
    try:
        import dask  # noqa: F401
        import distributed  # noqa: F401
    except ImportError as err:
        raise UsageError("fleet: needs dask.distributed; pip install 'benchctl[cluster]'") from err


@contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Return a client of the scheduler at an address, or of `workers` new processes that end with the block.

    Raises
    ------
    UsageError
        If no scheduler answers at the address, or the processes cannot be started.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # dask's, on versions and ports: their consequences are reported as errors
        import dask
        from distributed import (
            Client,
        )  # first, because otherwise the end of the settings block would remove its settings

        _hush()
        with dask.config.set(_SETTINGS):
            if scheduler is None:
                with _own_workers(workers) as cluster, Client(cluster) as client:
                    yield client
                return
            with _client_at(scheduler) as client:
                yield client


def _client_at(scheduler: str) -> Any:
    from distributed import Client

    try:
        asyncio.run(_greet(scheduler))
        return Client(scheduler, timeout=_CONNECT_S)
    except ValueError as err:
        raise UsageError(f"--scheduler {scheduler}: is no address; expected one such as tcp://lab-server:8786") from err
    except TimeoutError as err:
        raise _no_scheduler(scheduler, f"nothing came within {_CONNECT_S:g} s") from err
    except Exception as err:  # a server at the address may send any response
        raise _no_scheduler(scheduler, in_line(str(err)) or type(err).__name__) from err


def _no_scheduler(address: str, why: str) -> UsageError:
    return UsageError(
        f"--scheduler {address}: no Dask scheduler answers there ({why}); start one with `dask scheduler`, which "
        "prints its address, or leave --scheduler out"
    )


async def _greet(scheduler: str) -> None:
    """Connect to an address with a timeout: a client waits forever for a response of another kind of server."""
    from distributed import Security
    from distributed.comm import connect

    there = connect(scheduler, timeout=_CONNECT_S, **Security().get_connection_args("client"))
    comm = await asyncio.wait_for(there, _CONNECT_S)
    await comm.close()


def _hush() -> None:
    """Disable dask's log, whose tracebacks do not help a user: errors are reported in one line."""
    known = [*logging.root.manager.loggerDict, "distributed", "tornado", "asyncio"]
    for name in known:
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def _own_workers(count: int) -> Iterator[Any]:
    """Start processes with one thread each. They ignore Ctrl-C in the terminal; this process ends them."""
    from distributed import LocalCluster

    try:
        with _deaf():
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
    except (OSError, RuntimeError) as err:
        raise UsageError(
            f"{count} worker processes cannot be started here: {in_line(str(err))}; check the limits on memory and "
            "processes, or take fewer (--workers)"
        ) from err
    with cluster:
        yield cluster


@contextmanager
def _deaf() -> Iterator[None]:
    """Block Ctrl-C in the threads and processes that are started in the block, and in their children."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it unblocks signals in the thread that first starts it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_LOOK_S = 0.02
_AHEAD = 256
"""Number of jobs submitted in advance, or two per thread of a larger cluster."""
_DONE_AGAIN = ("lost", "pending")
"""Status of a finished job whose worker died before its outcome was fetched; the cluster runs it again."""


def outcomes(client: Any, jobs: Sequence[Job], stop: StopRequest) -> Iterator[tuple[Job, JobOutcome]]:
    """Run jobs on a dask client's cluster, the largest recordings first; yield each with its outcome when it ends.

    Raises
    ------
    StoppedError
        If a stop was requested; jobs that have not begun are cancelled.
    LinkError
        If the scheduler is gone, or has dropped the jobs; workers finish their current jobs.
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
                yield given.pop(future.key), outcome
    except (OSError, CancelledError) as err:
        futures.clear()  # the scheduler that could cancel them is gone
        raise LinkError(
            f"scheduler {client.scheduler.address}: is gone, or was restarted; the same command goes on"
        ) from err
    finally:
        if futures:
            client.cancel(list(futures.values()), force=True)


def _outcome_of(future: Any, status: str, job: Job) -> JobOutcome:
    """Return the outcome of a job by its future's status.

    Raises `OSError` or `CancelledError` if the scheduler is gone.
    """
    from distributed.scheduler import KilledWorker

    if status == "finished":
        outcome: JobOutcome = future.result()
        return outcome
    if status != "error":
        raise CancelledError
    error = future.exception()
    if isinstance(error, KilledWorker):
        reason = (
            f"{error.allowed_failures + 1} workers died of it: killed, out of memory, or by a fault of HDF5's library; "
            f"try it alone: benchctl {job.verb}"
        )
    else:
        reason = f"the worker could not do it: {type(error).__name__}: {in_line(str(error))}"
    return JobOutcome(state="failed", reason=f"{job.recording.where}: {reason}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Where a fleet runs and stores results; by default processes on this machine, and next to each recording."""

    scheduler: str | None = None
    workers: int | None = None
    out: str | None = None
    again: bool = False


def run_fleet(
    verb: FleetVerb,
    recordings: Sequence[Located],
    options: Options,
    settings: Settings,
    on_outcome: Callable[[Job, JobOutcome], None],
    say: Callable[[str], None],
    stop: StopRequest,
) -> Fleet:
    """Run a verb on recordings that need it; `on_outcome` is called with each outcome, `say` with warnings.

    Raises
    ------
    UsageError
        If dask is not installed, or no scheduler answers.
    """
    run = uuid.uuid4().hex
    jobs = [
        Job(
            verb=verb,
            recording=recording,
            place=place_of(recording, verb, settings.out),
            options=options,
            run=run,
            again=settings.again,
        )
        for recording in recordings
    ]
    ended: dict[str, JobOutcome] = {}

    def end(job: Job, outcome: JobOutcome) -> None:
        ended[job.recording.where] = outcome
        on_outcome(job, outcome)

    for job in jobs:
        if (outcome := kept(job)) is not None:
            end(job, outcome)
    to_do = [job for job in jobs if job.recording.where not in ended]
    if to_do:
        refuse_without_dask()
        workers = min(settings.workers or cores(), len(to_do))
        try:
            with connected(settings.scheduler, workers) as client:
                if not client.nthreads():
                    say(f"no workers at {settings.scheduler} yet: waiting; dask worker {settings.scheduler} starts one")
                for job, outcome in outcomes(client, to_do, stop):
                    end(job, outcome)
        except LinkError as err:
            say(str(err))
        except StoppedError:  # our workers are dead; those of other clusters finish their current jobs
            pass
    members = tuple(
        _member(job, ended[job.recording.where], settings.out) for job in jobs if job.recording.where in ended
    )
    return Fleet(verb=verb, members=members, left=len(jobs) - len(ended))


def _member(job: Job, outcome: JobOutcome, out: str | None) -> Member:
    """Return a recording of the fleet with the results of this verb and earlier results of the others."""
    records: dict[FleetVerb, JobRecord] = {}
    for verb in VERBS:
        place = place_of(job.recording, verb, out)
        record = outcome.record if verb == job.verb else _still_true(place, verb, job.recording)
        if record is not None:
            records[verb] = record
    unit = next(iter(records.values()), None)
    return Member(
        recording=job.recording.where,
        name=job.recording.name,
        serial=unit.serial if unit else "",
        model=unit.model if unit else "",
        state=outcome.state,
        reason=outcome.reason,
        stated={verb: record.stated for verb, record in records.items()},
        reports={verb: f"{place_of(job.recording, verb, out).where}/{REPORTS[verb]}" for verb in records},
    )


def _still_true(place: Place, verb: FleetVerb, recording: Located) -> JobRecord | None:
    """Return another verb's record of a recording that has not changed since."""
    try:
        record = record_at(place, verb)
    except BenchError:
        return None
    return record if record is not None and record.stamp == recording.stamp != () else None
