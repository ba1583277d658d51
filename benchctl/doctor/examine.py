"""Run all checks of the doctor: this machine, its disk and ports, and a bench if one is named."""

from __future__ import annotations

import platform
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import benchctl
from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.reserved import lock_files, make_lock_folder
from benchctl.certificates import expired
from benchctl.doctor.disk import disk_findings
from benchctl.doctor.finding import Finding, bad, look, ok
from benchctl.doctor.instruments import findings_of_instrument
from benchctl.doctor.ports import findings_of_port, port_findings
from benchctl.locks import held
from benchctl_instruments.catalog import Kind
from benchctl_instruments.errors import BenchNotReadyError, UsageError
from benchctl_instruments.links.address import Address, parse_address
from benchctl_instruments.rate_tables.manual import ONLY_THE_OPERATOR

LIMIT_S = 30.0
"""Wall time for one instrument: its driver's timeouts, and the search for the cause if it does not answer."""

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
        if role == "rate_table" and bench.by_hand:
            do = "stay within reach of it while it turns: a run and its guard only ask for a stop"
            findings[role] = [look(role, "manual", f"no wire to check. {ONLY_THE_OPERATOR}", do)]
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
    """Check one line under its lock; send nothing if another process holds the lock."""
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


BENCH = "bench"


def examine(source: str | None, results: Path) -> Iterator[Finding]:
    """Yield every finding; `source` is a bench as for `--bench`, or None to check this machine only."""
    yield ok("machine", "Python", f"{platform.python_implementation()} {platform.python_version()} at {sys.executable}")
    yield ok("machine", "benchctl", f"{benchctl.__version__} at {next(iter(benchctl.__path__))}")
    bench, wrong = None, None
    if source is not None:
        try:
            bench = load_bench(source)
        except UsageError as err:
            do = "correct that line; bench.schema.json, which benchctl init writes, lists the allowed keys in an editor"
            wrong = bad(BENCH, "bench.toml", str(err), do, unusable=True)
    sized_for = bench if bench is not None else load_bench(SIMULATED)
    yield from _guarded("results", lambda: disk_findings(results, sized_for))
    serial = bench is not None and not bench.simulated and _has_serial(bench)
    yield from _guarded("ports", lambda: port_findings(serial_wanted=serial))
    if wrong is not None:
        yield wrong
    if bench is not None:
        yield from _of_bench(bench)


def _of_bench(bench: Bench) -> Iterator[Finding]:
    yield ok(BENCH, "bench.toml", f"{bench.name}: valid")
    for each in expired(bench.entries, datetime.now(UTC).date()):
        do = f"have the {each.role} calibrated, or enter its new certificate: reports state that it has expired"
        yield look(BENCH, "certificate", each.message, do)
    if not bench.simulated:
        yield from line_findings(bench)
        return
    if named := [role for role, entry in bench.entries.items() if entry.address]:
        message = f"simulated = true: the addresses of {', '.join(named)} only select the kind of simulated line"
        yield look(BENCH, "addresses", message, "set simulated = false to check the real instruments")
    yield from _guarded(BENCH, lambda: _simulated(bench))


def _simulated(bench: Bench) -> Iterator[Finding]:
    """Start the simulated instruments and identify each over its wire."""
    try:
        with open_bench(bench, purpose="benchctl doctor") as opened:
            for role, who in opened.identities.items():
                identity = " ".join(word for word in (who.manufacturer, who.model, who.serial) if word)
                how = "has no wire" if role == "rate_table" and bench.by_hand else "answers over its wire"
                yield ok(role, "identity", f"simulated; {how}: {identity or 'without an identity'}")
    except BenchNotReadyError as err:
        for role, failure in err.failures.items():
            yield bad(
                role,
                "identity",
                " ".join(str(failure).split()),
                f"correct [{role}] and its options in the bench",
                unusable=isinstance(failure, UsageError),
            )
    except UsageError as err:
        yield bad(BENCH, "simulation", str(err), "correct that table of the bench", unusable=True)


def _has_serial(bench: Bench) -> bool:
    return any((entry.address or "").startswith("serial://") for entry in bench.entries.values())


def _guarded(where: str, part: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """Yield the findings of a part; an exception in one part must not hide the findings of the others."""
    try:
        yield from part()
    except Exception as err:
        message = f"the check raised {type(err).__name__}: {' '.join(str(err).split())}"
        yield look(where, f"doctor on {sys.platform}", message, "report it to the makers of benchctl")
