"""A fleet on a real local cluster, one for all tests of this file: a scheduler, and another process that works."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from benchctl.app.fit import fit
from benchctl.campaign.stop import StopRequest
from benchctl.fleet.cluster import Settings, connected, run_fleet
from benchctl.fleet.job import Options
from benchctl.fleet.located import located
from benchctl.reports.fleet_facts import Fleet
from benchctl_instruments.errors import UsageError
from tests.benchctl.fleet.made import fitted, points


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster on this machine, whose one worker is a process of its own."""
    with connected(None, 1) as client:
        yield client.scheduler.address


def states(fleet: Fleet) -> dict[str, str]:
    return {member.name: member.state for member in fleet.members}


@pytest.mark.slow
def test_a_fleet_does_what_is_missing_or_changed_and_one_bad_recording_does_not_stop_it(
    tmp_path: Path, scheduler: str
) -> None:
    for number in range(3):
        points(tmp_path / f"u{number}.h5", number)
    (tmp_path / "bad.h5").write_bytes(b"no recording")
    first = fitted(tmp_path, scheduler)
    assert states(first) == {"bad": "failed", "u0": "done", "u1": "done", "u2": "done"}
    (bad,) = first.ended("failed")
    assert bad.reason.startswith(f"{tmp_path / 'bad.h5'}: is not an HDF5 file (12 bytes)")
    for number in range(3):  # to the last byte what the single verb writes
        fit([tmp_path / f"u{number}.h5"], out=tmp_path / "single")
        for name in ("coefficients.json", "report.html"):
            assert (tmp_path / f"u{number}.fit" / name).read_bytes() == (tmp_path / "single" / name).read_bytes()

    points(tmp_path / "u1.h5", 17)
    points(tmp_path / "new.h5", 5)
    (tmp_path / "u2.fit" / "report.html").unlink()
    second = fitted(tmp_path, scheduler)
    assert states(second) == {"bad": "failed", "new": "done", "u0": "kept", "u1": "done", "u2": "done"}
    figures = {one.name: one.stated["fit"].figures for one in second.members if one.state != "failed"}
    assert figures["u0"] == next(one for one in first.members if one.name == "u0").stated["fit"].figures
    assert figures["u1"] != next(one for one in first.members if one.name == "u1").stated["fit"].figures
    assert not list(tmp_path.glob(".*"))


def test_a_fleet_that_is_all_done_needs_no_cluster(tmp_path: Path, scheduler: str) -> None:
    points(tmp_path / "u0.h5", 0)
    fitted(tmp_path, scheduler)
    assert states(fitted(tmp_path, "tcp://127.0.0.1:1")) == {"u0": "kept"}


def test_a_stop_leaves_what_was_not_begun_to_the_next_run(tmp_path: Path, scheduler: str) -> None:
    points(tmp_path / "u0.h5", 0)
    stop = StopRequest()
    stop.ask("Ctrl-C")
    stopped = run_fleet(
        "fit",
        located([str(tmp_path / "u0.h5")])[0],
        Options(),
        Settings(scheduler=scheduler),
        on_outcome=lambda job, outcome: None,
        say=lambda text: None,
        stop=stop,
    )
    assert (stopped.members, stopped.left) == ((), 1)
    assert states(fitted(tmp_path, scheduler))["u0"] in ("done", "kept")  # a worker may have been at it already


@pytest.mark.parametrize(
    ("address", "says"),
    [
        pytest.param(
            "tcp://127.0.0.1:1", r"no Dask scheduler answers there \(.*`dask scheduler`", marks=pytest.mark.slow
        ),
        ("nosuch://host:1", "is no address; expected one such as tcp://"),
        ("127.0.0.1:port", "is no address; expected one such as tcp://"),
    ],
)
def test_a_scheduler_that_does_not_answer_is_told_in_one_line(tmp_path: Path, address: str, says: str) -> None:
    points(tmp_path / "u0.h5", 0)
    with pytest.raises(UsageError, match=rf"^--scheduler {address}: {says}"):
        fitted(tmp_path, address)


@pytest.mark.slow
def test_what_listens_and_is_no_scheduler_is_not_waited_for(tmp_path: Path) -> None:
    points(tmp_path / "u0.h5", 0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(UsageError, match=r"no Dask scheduler answers there \(nothing came within 5 s\)"):
            fitted(tmp_path, address)


def test_what_answers_and_is_no_scheduler_is_told_in_one_line(tmp_path: Path) -> None:
    points(tmp_path / "u0.h5", 0)
    with socket.create_server(("127.0.0.1", 0)) as other, ThreadPoolExecutor(1) as pool:
        pool.submit(lambda: other.accept()[0].sendall(b"SSH-2.0-OpenSSH_9.9 and more of it\r\n"))
        with pytest.raises(UsageError, match="no Dask scheduler answers there") as refused:
            fitted(tmp_path, f"tcp://127.0.0.1:{other.getsockname()[1]}")
    assert "\n" not in str(refused.value)
