"""A Dask cluster: one that is there already, by its scheduler's address, or processes on this machine for the while."""

from __future__ import annotations

import asyncio
import logging
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

from benchctl_instruments.errors import UsageError, in_line

_CONNECT_S = 5.0
_ENOUGH = 1_000_000
"""Deaths of workers after which a scheduler of ours would give a task up: never; a job's own notes decide."""

_SETTINGS = {
    "distributed.scheduler.allowed-failures": _ENOUGH,
    "distributed.scheduler.worker-saturation": 1.0,  # a job that is as good as begun dies with its worker
    "distributed.worker.profile.enabled": False,
    # dask looks at these up to 50 times a second in every process, which costs 5 % of a fleet's time on two cores
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.comm.timeouts.connect": f"{_CONNECT_S:g}s",
}


def refuse_without_dask() -> None:
    """Raise `UsageError` where the extra is not installed."""
    try:
        import dask  # noqa: F401
        import distributed  # noqa: F401
    except ImportError as err:
        raise UsageError("fleet: needs dask.distributed; pip install 'benchctl[cluster]'") from err


@contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Any]:
    """A client of the scheduler at an address, or of so many new processes on this machine, which end with the block.

    Raises
    ------
    UsageError
        Where no scheduler answers at the address, or no processes can be started.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # dask's own, on versions and ports: what fails because of them is told
        import dask
        from distributed import Client  # first, as the end of the settings would take its own away with them

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
    except Exception as err:  # whatever is at the address may answer anything
        raise _no_scheduler(scheduler, in_line(str(err)) or type(err).__name__) from err


def _no_scheduler(address: str, why: str) -> UsageError:
    return UsageError(
        f"--scheduler {address}: no Dask scheduler answers there ({why}); start one with `dask scheduler`, which "
        "prints its address, or leave --scheduler out"
    )


async def _greet(scheduler: str) -> None:
    """Meet what is at an address, for a while only: a client waits for ever for the answer of what is no scheduler."""
    from distributed import Security
    from distributed.comm import connect

    there = connect(scheduler, timeout=_CONNECT_S, **Security().get_connection_args("client"))
    comm = await asyncio.wait_for(there, _CONNECT_S)
    await comm.close()


def _hush() -> None:
    """Silence dask's log, whose tracebacks tell a user nothing: what fails is told in words."""
    known = [*logging.root.manager.loggerDict, "distributed", "tornado", "asyncio"]
    for name in known:
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def _own_workers(count: int) -> Iterator[Any]:
    """Processes with a thread each. Ctrl-C in a terminal reaches all: they leave it to this process to end them."""
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
    """Threads and processes that are started in the block take no Ctrl-C, nor do those that they start."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which lets signals through again in the thread that first starts it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
