"""Run all checks of the doctor: this machine, its disk and ports, and a bench where one is named."""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import benchctl
from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.certificates import expired
from benchctl.doctor.disk import disk_findings
from benchctl.doctor.finding import Finding, bad, look, ok
from benchctl.doctor.lines import line_findings
from benchctl.doctor.ports import port_findings
from benchctl_instruments.errors import BenchNotReadyError, UsageError

BENCH = "bench"


def examine(source: str | None, results: Path) -> Iterator[Finding]:
    """Yield every finding; `source` names a bench as `--bench` does, None: this machine only."""
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
        yield look(BENCH, "certificate", each.says, do)
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
                yield ok(role, "identity", f"simulated; answers over its wire: {identity or 'without an identity'}")
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
