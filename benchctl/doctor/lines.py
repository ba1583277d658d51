"""Check the instruments of a real bench: each line in a thread, with a time limit."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from benchctl.bench import Bench
from benchctl.campaign.reserved import lock_files, make_lock_folder
from benchctl.doctor.finding import Finding, bad, look
from benchctl.doctor.instruments import findings_of_instrument
from benchctl.doctor.ports import findings_of_port
from benchctl.locks import held
from benchctl_instruments.catalog import Kind
from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import Address, parse_address

LIMIT_S = 30.0
"""Wall time for one instrument: its driver's timeouts, and the search for the cause where it does not answer."""

_ROLES: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer", "gyro")


class _Place(NamedTuple):
    role: Kind
    address: Address


class _Line(NamedTuple):
    """Instruments that share a port, or a host and port, with the findings of each so far."""

    places: list[_Place]
    found: dict[str, list[Finding]]


def line_findings(bench: Bench, limit_s: float = LIMIT_S) -> Iterator[Finding]:
    """Check all instruments, different lines at the same time; yield findings in the order of the roles."""
    lines: dict[tuple[Path, ...], _Line] = {}
    findings: dict[str, list[Finding]] = {}
    for role in _ROLES:
        if role not in bench.entries:
            continue
        try:
            address = parse_address(bench.entries[role].address or "")
        except UsageError as err:
            findings[role] = [bad(role, "address", str(err), f"correct {role}.address", unusable=True)]
            continue
        line = lines.setdefault(lock_files(str(address)), _Line([], {}))
        line.places.append(_Place(role, address))
        line.found[role] = findings[role] = []
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
        yield from list(findings.get(role, ()))


def _look_at(bench: Bench, locks: tuple[Path, ...], line: _Line) -> None:
    """Check one line under its lock; send nothing where another process holds it."""
    first = line.places[0]
    try:
        make_lock_folder()
        with held(locks, f"{first.role} at {first.address}", "benchctl doctor", settles=False):
            for role, address in line.places:
                _look_at_one(bench, role, address, line.found[role])
    except UsageError as err:
        for role, _ in line.places:
            do = "repeat the check when it has ended: nothing was sent, so that its run is not disturbed"
            line.found[role].append(look(role, "in use", str(err), do))


def _look_at_one(bench: Bench, role: Kind, address: Address, found: list[Finding]) -> None:
    try:
        if address.scheme == "serial":
            found.extend(findings_of_port(role, address))
            if found[-1].verdict == "bad":
                return
        for finding in findings_of_instrument(bench, role, address):
            found.append(finding)
    except Exception as err:  # an exception here must not hide the other findings
        do = "report it to the makers of benchctl"
        found.append(bad(role, "doctor", f"the check raised {type(err).__name__}: {err}", do))


def _note_late(line: _Line, allowed_s: float) -> None:
    for role, address in line.places:
        if not line.found[role] or line.found[role][-1].verdict != "bad":
            do = "its driver does not return: switch the instrument off and on, and repeat the check"
            line.found[role].append(bad(role, "answer", f"{address}: not finished within {allowed_s:g} s", do))
