"""The guard acts on simulated instruments, over their real wires."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.guard.orders import Orders, Reached
from benchctl.campaign.guard.rescue import note, rescue
from benchctl.campaign.opened import simulated_bench
from benchctl.locks import Lock
from benchctl_instruments.catalog import driver
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.bench import SimulatedBench
from benchctl_instruments.simulated.clock import ScaledClock

SPEED = 50.0


@contextmanager
def in_motion(folder: Path) -> Iterator[tuple[SimulatedBench, Orders]]:
    """A bench that somebody left with the table turning and the chamber at 60 °C; and what its guard was told."""
    bench: Bench = load_bench("simulated")
    clock = ScaledClock(SPEED)
    with simulated_bench(bench, clock) as servers:
        addresses = servers.addresses
        with _driver("rate_table", "acutrol3000", addresses, clock) as table:
            table.enable()
            table.go_to_rate(120.0)
        with _driver("chamber", "watlow_f4t", addresses, clock) as chamber:
            chamber.go_to(60.0)
        yield (
            servers,
            Orders(
                runner=1,
                journal=folder / "journal.jsonl",
                time_factor=SPEED,
                rest_within_s=6.0,
                safe_c=23.0,
                rate_table=_reached("acutrol3000", addresses["rate_table"], folder),
                chamber=_reached("watlow_f4t", addresses["chamber"], folder),
            ),
        )


def _driver(kind: Any, model: str, addresses: dict[str, str], clock: ScaledClock) -> Any:
    return driver(kind, model)(addresses[kind], clock=clock)


def _reached(model: str, address: str, folder: Path) -> Reached:
    return Reached(model=model, address=address, options={"timeout_s": 0.3}, locks=[str(folder / f"{model}.lock")])


def test_the_table_is_stopped_the_chamber_sent_home_and_both_are_read_back(tmp_path: Path) -> None:
    told: list[str] = []
    with in_motion(tmp_path) as (servers, orders):
        rescued = rescue(orders, told.append)
        assert rescued.rate_dps is not None
        assert abs(rescued.rate_dps) < 0.05
        assert (rescued.chamber_setpoint_c, rescued.problems) == (23.0, ())
        assert abs(servers.world.table.motion().rate_dps) < 0.05
        assert servers.world.chamber.setpoint_c() == 23.0
    assert told == ["taking over"]


def test_an_instrument_that_does_not_answer_costs_the_other_one_nothing_and_is_named(tmp_path: Path) -> None:
    told: list[str] = []
    with in_motion(tmp_path) as (servers, orders), socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        deaf = replace(orders, rate_table=replace(orders.rate_table, address=address))
        rescued = rescue(deaf, told.append, give_up_s=0.1)
        assert servers.world.chamber.setpoint_c() == 23.0
    assert (rescued.rate_dps, rescued.chamber_setpoint_c) == (None, 23.0)
    (problem,) = rescued.problems
    assert problem.startswith(f"rate_table: rate table at {address}: ")
    assert told[0] == "taking over"
    assert told[1] == f"trying again: {problem}"


def test_an_instrument_that_comes_back_is_brought_to_rest_then(tmp_path: Path) -> None:
    with in_motion(tmp_path) as (servers, orders):
        servers.rate_table.stop()
        back = threading.Timer(0.8, servers.rate_table.start)
        back.start()
        rescued = rescue(orders, lambda says: None)
        back.join()
        assert rescued.problems == ()
        assert abs(servers.world.table.motion().rate_dps) < 0.05


def test_what_another_run_has_taken_meanwhile_is_left_to_it(tmp_path: Path) -> None:
    with in_motion(tmp_path) as (servers, orders):
        lock = Lock(Path(*orders.rate_table.locks), "rate_table")
        lock.acquire("campaign results/next")
        rescued = rescue(orders, lambda says: None, give_up_s=0.1)
        lock.release()
        assert servers.world.table.motion().rate_dps == pytest.approx(120.0, abs=1.0)
    (problem,) = rescued.problems
    assert "is in use by process" in problem
    assert "campaign results/next" in problem


def test_a_folder_of_locks_that_is_gone_keeps_no_table_turning(tmp_path: Path) -> None:
    with in_motion(tmp_path) as (servers, orders):
        lost = replace(orders.rate_table, locks=[str(tmp_path / "logged-out" / "table.lock")])
        rescued = rescue(replace(orders, rate_table=lost), lambda says: None)
        assert abs(servers.world.table.motion().rate_dps) < 0.05
    assert rescued.problems == ()


def test_whatever_a_driver_does_wrong_the_other_instrument_is_brought_to_rest(tmp_path: Path) -> None:
    with in_motion(tmp_path) as (servers, orders):
        wrong = replace(orders, chamber=replace(orders.chamber, options={"no_such_option": 1}))
        rescued = rescue(wrong, lambda says: None, give_up_s=0.1)
        assert abs(servers.world.table.motion().rate_dps) < 0.05
    assert len(rescued.problems) == 1
    assert "no_such_option" in rescued.problems[0]


def test_a_journal_line_that_the_runner_had_only_begun_spoils_no_other(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    for before in (b"", b'{"kind": "step"}\n', b'{"kind": "st'):
        journal.write_bytes(before)
        note(journal, says="taking over", rate_dps=0.0)
        lines = journal.read_text(encoding="utf-8").splitlines()
        assert len(lines) == len(before.splitlines()) + 1
        event = json.loads(lines[-1])
        assert (event["kind"], event["says"], event["rate_dps"]) == ("guard", "taking over", 0.0)
        assert time.strptime(event["wall_time"][:19], "%Y-%m-%dT%H:%M:%S")


def test_a_journal_that_cannot_be_written_is_an_error_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"gone/journal\.jsonl: cannot be written"):
        note(tmp_path / "gone" / "journal.jsonl", says="taking over")
