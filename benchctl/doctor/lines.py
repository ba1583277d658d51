"""The instruments of a real bench, line by line: each line in a thread of its own, each with its own time limit."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from benchctl.bench import Bench
from benchctl.campaign.reserved import lock_files, make_lock_folder
from benchctl.doctor.finding import Finding, bad, look
from benchctl.doctor.instruments.asking import findings_of_instrument
from benchctl.doctor.ports.port import findings_of_port
from benchctl.locks import held
from benchctl_instruments.catalog import Kind
from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import Address, parse_address

LIMIT_S = 30.0
"""Wall time for one instrument: its driver's own patience, and finding out why it does not answer."""

_ROLES: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer", "gyro")


class _Place(NamedTuple):
    role: Kind
    address: Address


class _Line(NamedTuple):
    """Instruments that share a port, or a host and port, and what is known of each so far."""

    places: list[_Place]
    found: dict[str, list[Finding]]


def line_findings(bench: Bench, limit_s: float = LIMIT_S) -> Iterator[Finding]:
    """All instruments, those of different lines at the same time, told in the order of their roles."""
    lines: dict[tuple[Path, ...], _Line] = {}
    told: dict[str, list[Finding]] = {}
    for role in _ROLES:
        if role not in bench.entries:
            continue
        try:
            address = parse_address(bench.entries[role].address or "")
        except UsageError as err:
            told[role] = [bad(role, "address", str(err), f"correct {role}.address", unusable=True)]
            continue
        line = lines.setdefault(lock_files(str(address)), _Line([], {}))
        line.places.append(_Place(role, address))
        line.found[role] = told[role] = []
    threads = {
        locks: threading.Thread(target=_look_at, args=(bench, locks, line), name=f"doctor {locks[0]}", daemon=True)
        for locks, line in lines.items()
    }
    began_s = time.monotonic()
    for thread in threads.values():
        thread.start()
    for locks, thread in threads.items():
        allowed_s = limit_s * len(lines[locks].places)
        thread.join(max(0.0, began_s + allowed_s - time.monotonic()))
        if thread.is_alive():
            _note_late(lines[locks], allowed_s)
    for role in _ROLES:
        yield from list(told.get(role, ()))


def _look_at(bench: Bench, locks: tuple[Path, ...], line: _Line) -> None:
    """One line, which is this process' alone meanwhile; nothing is sent where another process has it."""
    first = line.places[0]
    try:
        make_lock_folder()
        with held(locks, f"{first.role} at {first.address}", "benchctl doctor", settles=False):
            for role, address in line.places:
                _look_at_one(bench, role, address, line.found[role])
    except UsageError as err:
        for role, _ in line.places:
            do = "look again when it is done: nothing was asked, so that nothing is disturbed"
            line.found[role].append(look(role, "in use", str(err), do))


def _look_at_one(bench: Bench, role: Kind, address: Address, found: list[Finding]) -> None:
    try:
        if address.scheme == "serial":
            found.extend(findings_of_port(role, address))
            if found[-1].verdict == "bad":
                return
        for finding in findings_of_instrument(bench, role, address):
            found.append(finding)
    except Exception as err:  # a fault of the doctor's own must not hide what the others show
        do = "tell those who make benchctl"
        found.append(bad(role, "doctor", f"looking failed with {type(err).__name__}: {err}", do))


def _note_late(line: _Line, allowed_s: float) -> None:
    for role, address in line.places:
        if not line.found[role] or line.found[role][-1].verdict != "bad":
            do = "its driver waits without an end: switch the instrument off and on, and look again"
            line.found[role].append(bad(role, "answer", f"{address}: no end within {allowed_s:g} s", do))
