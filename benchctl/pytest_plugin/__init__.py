"""pytest plug-in of benchctl: fixtures with a simulated bench, and test files that consist of a procedure and limits.

The plug-in is active wherever benchctl is installed, and imports benchctl only when a fixture or a file is used.

| fixture           | value                                                                                   |
|-------------------|-----------------------------------------------------------------------------------------|
| `benchctl_bench`  | the opened simulated bench of this test: `table`, `chamber`, `digitizer`, `clock`, …    |
| `benchctl_clock`  | its virtual clock: `now()` in s since the test began; `sleep(seconds)` returns at once  |
| `benchctl_faults` | its faults: `fired`, the faults that have occurred so far, oldest first                 |
| `benchctl_run`    | `benchctl_run("static", duration_s=60)` runs a procedure and returns an `Outcome`       |
| `benchctl_server` | simulated instruments in real time, for other programs: `addresses`, `bench_file`       |

Two markers change that bench:

`benchctl_bench("lab/bench.toml", seed=7, limits={"rate_dps": 200.0}, chamber={"model": "espec_p300"})`
    uses another simulated bench than the template. `seed` is the seed of its noise; other keywords are tables and
    fields of bench.toml that replace those of the file.
`benchctl_fault(on="chamber", kind="silence", from_s=600.0, times=3)`
    adds one of the `[[faults]]` of bench.toml, which starts at its time; may be repeated.

Every test has a new bench with the same seed. Recordings are in the test's `tmp_path`.

    @pytest.mark.benchctl_fault(on="chamber", kind="silence", from_s=60.0, times=2)
    def test_a_silent_chamber_is_waited_for(benchctl_run, benchctl_faults):
        outcome = benchctl_run("static", soak_s=600, duration_s=10)
        assert outcome.status == "complete"
        assert len(benchctl_faults.fired) == 2

A file whose name ends in `.bench-test.toml` describes a campaign and its limits. Its tests are `campaign`, which passes
if every step was run, and one test per limit: passed, failed, or INCONCLUSIVE, which also fails, but has its own letter
(I), count and section. `--junitxml` reports them with their values as properties.

    procedure = "acceptance"         # a name, or the path of a .py file, relative to this file
    bench = "bench.toml"             # a path relative to this file; default: the simulated bench
    limits = "limits.toml"           # a relative path, a file as for benchctl accept; default: no limits
    seed = 7                         # seed of the noise of a simulated bench; optional
    [parameters]
    soak_s = 3600.0

`--benchctl-out DIR` keeps the campaigns, each with its acceptance.html; without it they are removed at the end. Tests
of a bench that is not simulated are skipped without `--benchctl-hardware`.
"""

from __future__ import annotations

import tempfile
import uuid
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchctl.pytest_plugin.fixtures import (
    ENDING,
    benchctl_bench,
    benchctl_clock,
    benchctl_faults,
    benchctl_run,
    benchctl_server,
)

if TYPE_CHECKING:
    from benchctl.pytest_plugin.files import BenchTestFile

__all__ = ["benchctl_bench", "benchctl_clock", "benchctl_faults", "benchctl_run", "benchctl_server"]

_SHARED = pytest.StashKey[Path]()
"""Folder in which the processes of one session share the completed campaigns."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of this plug-in."""
    group = parser.getgroup("benchctl", "benchctl: procedures as tests")
    group.addoption("--benchctl-out", metavar="DIR", help=f"keep the campaigns of *{ENDING} there, with their reports")
    group.addoption(
        "--benchctl-hardware", action="store_true", help=f"let *{ENDING} move benches that are not simulated"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers, and set the folder that all processes of this session share."""
    config.addinivalue_line(
        "markers", "benchctl_bench(file, seed=None, **tables): the bench of the benchctl fixtures, and what differs"
    )
    config.addinivalue_line("markers", "benchctl_fault(on, kind, **when): a fault of that bench, as in [[faults]]")
    given = getattr(config, "workerinput", {}).get("benchctl")
    config.stash[_SHARED] = Path(given or Path(tempfile.gettempdir()) / f"benchctl-{uuid.uuid4().hex}")


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: object) -> None:
    """Pass the controller's folder to a worker of xdist."""
    node.workerinput["benchctl"] = str(node.config.stash[_SHARED])  # type: ignore[attr-defined]  # xdist's own class


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the campaigns that are not kept."""
    shared = config.stash.get(_SHARED, None)
    if shared is not None and not hasattr(config, "workerinput") and shared.exists():
        import shutil

        shutil.rmtree(shared, ignore_errors=True)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> BenchTestFile | None:
    """Collect files that describe a campaign and its limits."""
    if not file_path.name.endswith(ENDING):
        return None
    from benchctl.pytest_plugin.files import BenchTestFile

    return BenchTestFile.from_parent(parent, path=file_path, shared=parent.config.stash[_SHARED])


def pytest_report_teststatus(
    report: pytest.CollectReport | pytest.TestReport,
) -> tuple[str, str, tuple[str, dict[str, bool]]] | None:
    """Report INCONCLUSIVE as a separate category; the session fails nevertheless."""
    if isinstance(report, pytest.TestReport) and report.failed and _is_inconclusive(report):
        return "inconclusive", "I", ("INCONCLUSIVE", {"yellow": True})
    return None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """List the inconclusive tests with their reasons, and the location of the reports."""
    for report in terminalreporter.getreports("inconclusive"):
        if report is terminalreporter.getreports("inconclusive")[0]:
            terminalreporter.section("INCONCLUSIVE", yellow=True)
        terminalreporter.write_line(f"{report.nodeid}: {report.longreprtext}")
    kept = config.getoption("--benchctl-out")
    if kept and config.stash[_SHARED].exists():
        terminalreporter.write_line(f"benchctl: the campaigns and their reports are in {kept}")


def _is_inconclusive(report: pytest.TestReport) -> bool:
    return ["verdict", "INCONCLUSIVE"] in [list(pair) for pair in report.user_properties]
