"""The whole examination: this machine, and a bench where one is named."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.certificates import expired
from benchctl.doctor.finding import MACHINE, Finding, bad, look, ok
from benchctl.doctor.lines import line_findings
from benchctl.doctor.machine.clock import clock_findings
from benchctl.doctor.machine.folder import folder_findings
from benchctl.doctor.machine.resources import resource_findings
from benchctl.doctor.machine.session import session_findings
from benchctl.doctor.machine.simulation import simulation_findings
from benchctl.doctor.machine.sleep import sleep_findings
from benchctl.doctor.machine.software import software_findings
from benchctl.doctor.network.firewalls import firewall_findings
from benchctl.doctor.ports.listed import port_findings
from benchctl_instruments.errors import BenchNotReadyError, UsageError

BENCH = "bench"
_PARTS: tuple[Callable[[], Iterator[Finding]], ...] = (
    software_findings,
    clock_findings,
    sleep_findings,
    session_findings,
    resource_findings,
    simulation_findings,
)


def examine(source: str | None, results: Path) -> Iterator[Finding]:
    """Every finding, one after the other; `source` names a bench as `--bench` does, None: this machine only."""
    for part in _PARTS:
        yield from _guarded(MACHINE, part)
    bench, wrong = None, None
    if source is not None:
        try:
            bench = load_bench(source)
        except UsageError as err:
            wrong = bad(
                BENCH,
                "bench.toml",
                str(err),
                "correct that line; bench.schema.json tells an editor what may stand there (benchctl init writes it)",
                unusable=True,
            )
    stands = bench if bench is not None else load_bench(SIMULATED)
    yield from _guarded("results", lambda: folder_findings(results, stands))
    yield from _guarded("ports", lambda: port_findings(serial_wanted=_wants(bench, ("serial://",))))
    if _wants(bench, ("tcp://", "socket://")):
        yield from _guarded("network", firewall_findings)
    if wrong is not None:
        yield wrong
    if bench is not None:
        yield from _of_bench(bench)


def _of_bench(bench: Bench) -> Iterator[Finding]:
    yield ok(BENCH, "bench.toml", f"{bench.name}: read, and nothing in it contradicts itself")
    for each in expired(bench.entries, datetime.now(UTC).date()):
        do = f"have the {each.role} calibrated, or enter its new certificate: reports will say that it has expired"
        yield look(BENCH, "certificate", each.says, do)
    if bench.simulated:
        if named := [role for role, entry in bench.entries.items() if entry.address]:
            says = (
                f"simulated = true: the addresses of {', '.join(named)} say on what kind of line to simulate, no more"
            )
            yield look(BENCH, "addresses", says, "set simulated = false to have the real instruments looked at")
        yield from _guarded(BENCH, lambda: _simulated(bench))
    else:
        yield from line_findings(bench)


def _simulated(bench: Bench) -> Iterator[Finding]:
    """The simulated instruments, started for a moment and asked over their wires."""
    try:
        with open_bench(bench, purpose="benchctl doctor") as opened:
            for role, who in opened.identities.items():
                said = " ".join(word for word in (who.manufacturer, who.model, who.serial) if word)
                yield ok(
                    role, "identity", f"simulated, and answers over its wire: {said or 'it does not say who it is'}"
                )
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


def _wants(bench: Bench | None, schemes: tuple[str, ...]) -> bool:
    if bench is None or bench.simulated:
        return False
    return any((entry.address or "").startswith(schemes) for entry in bench.entries.values())


def _guarded(where: str, part: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """The findings of a part; what it stumbles over itself hides none of the others."""
    try:
        yield from part()
    except Exception as err:
        says = f"looking failed with {type(err).__name__}: {' '.join(str(err).split())}"
        yield look(where, f"doctor on {sys.platform}", says, "tell those who make benchctl; the rest was looked at")
