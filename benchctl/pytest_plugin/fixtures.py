"""The fixtures; benchctl is imported only when one is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from benchctl.bench import Bench
    from benchctl.campaign.opened import OpenBench
    from benchctl.campaign.runner import Outcome
    from benchctl.plan import Plan, Procedure
    from benchctl_instruments.simulated.bench import SimulatedBench
    from benchctl_instruments.simulated.clock import VirtualClock
    from benchctl_instruments.simulated.faults.schedule import Fired

ENDING = ".bench-test.toml"
"""End of the names of files that describe a campaign and its limits."""


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults of a test's bench."""

    _bench: SimulatedBench

    @property
    def fired(self) -> tuple[Fired, ...]:
        """The faults that have occurred so far, oldest first: bench time [s], instrument, kind, operation."""
        return self._bench.fired


@dataclass(frozen=True, slots=True)
class Runner:
    """Runs procedures on a test's bench, one after the other."""

    _opened: OpenBench
    _folder: Path

    def __call__(self, procedure: str | Path | Procedure | Plan, *, check: bool = True, **parameters: Any) -> Outcome:
        """Run a procedure with these parameters, or a plan; return the same as `benchctl.api.run`.

        With `check`, a `BenchError` that ends it early is raised; otherwise the outcome contains it.
        """
        from benchctl import api
        from benchctl.app.run import free_folder, play_on

        plan = procedure if isinstance(procedure, api.Plan) else api.plan(procedure, **parameters)
        outcome = play_on(plan, self._opened, free_folder(self._folder, plan.procedure), warn=pytest.fail)
        if check:
            outcome.raise_error()
        return outcome


@dataclass(frozen=True, slots=True)
class Server:
    """Simulated instruments for other programs.

    `addresses` are keyed by the instruments' names in bench.toml; `bench_file` is a bench.toml for
    `benchctl run --bench`; `simulated` is the simulated bench itself.
    """

    addresses: Mapping[str, str]
    bench_file: Path
    simulated: SimulatedBench


@pytest.fixture
def benchctl_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[OpenBench]:
    """The simulated bench of this test, opened through its wire protocols on a virtual clock."""
    from benchctl.campaign.opened import open_bench

    with ExitStack() as stack:
        with _in_a_line():
            opened = stack.enter_context(open_bench(bench_of(request.node, tmp_path)))
        yield opened


@pytest.fixture
def benchctl_clock(benchctl_bench: OpenBench) -> VirtualClock:
    """The virtual clock of this test's bench: `now()`, `sleep(seconds)`."""
    from benchctl_instruments.simulated.clock import VirtualClock

    clock = benchctl_bench.clock
    if not isinstance(clock, VirtualClock):
        raise TypeError(f"a simulated bench runs on a virtual clock, this one on {clock!r}")
    return clock


@pytest.fixture
def benchctl_faults(benchctl_bench: OpenBench) -> Faults:
    """The faults of this test's bench: `fired`."""
    if benchctl_bench.simulated is None:
        raise TypeError("a simulated bench has servers, this one has none")
    return Faults(benchctl_bench.simulated)


@pytest.fixture
def benchctl_run(benchctl_bench: OpenBench, tmp_path: Path) -> Runner:
    """Runs procedures on this test's bench; recordings are written to `tmp_path`."""
    return Runner(benchctl_bench, tmp_path)


@pytest.fixture
def benchctl_server(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Server]:
    """Simulated instruments as servers; `time_factor` in bench.toml is the number of bench seconds per wall second."""
    from benchctl.campaign.opened import bench_toml_at, simulated_bench
    from benchctl_instruments.simulated.clock import ScaledClock

    with ExitStack() as stack:
        with _in_a_line():
            bench = bench_of(request.node, tmp_path)
            servers = stack.enter_context(simulated_bench(bench, ScaledClock(bench.time_factor)))
        reached = tmp_path / "reached.toml"
        reached.write_text(bench_toml_at(bench, servers.addresses, bench.time_factor), encoding="utf-8")
        yield Server(servers.addresses, reached, servers)


@contextmanager
def _in_a_line() -> Iterator[None]:
    """Report a bench that cannot be opened in one line."""
    from benchctl_instruments.errors import BenchError

    try:
        yield
    except BenchError as err:
        raise pytest.fail.Exception(f"benchctl: {err}", pytrace=False) from None


def bench_of(node: pytest.Item, folder: Path) -> Bench:
    """Return the bench of the markers `benchctl_bench` and `benchctl_fault`; without them, the simulated bench.

    Its bench.toml is written to `folder`, for later inspection.

    Raises
    ------
    UsageError
        If it cannot be used, or is not simulated.
    """
    import tomllib

    import tomli_w

    from benchctl.bench import load_bench
    from benchctl_instruments.errors import UsageError

    marker = node.get_closest_marker("benchctl_bench")
    file, seed, tables = _bench_marker(*marker.args, **marker.kwargs) if marker else _bench_marker()
    base = load_bench(file)
    document = tomllib.loads(base.text)
    document["chamber"]["model"] = base.chamber.model  # absolute path of a profile, since the copy is in another folder
    faults = [_fault(*mark.args, **mark.kwargs) for mark in node.iter_markers("benchctl_fault")]
    if faults:
        document["faults"] = [*document.get("faults", []), *reversed(faults)]  # the test's own come last
    path = folder / "bench.toml"
    path.write_text(tomli_w.dumps(_changed(document, tables)), encoding="utf-8")
    bench = load_bench(str(path)).with_seed(seed)
    if not bench.simulated:
        raise UsageError(f"benchctl_bench {file}: expected a bench with simulated = true; fixtures move nothing real")
    return bench


def _bench_marker(
    file: Any = "simulated", seed: int | None = None, **tables: Any
) -> tuple[str, int | None, dict[str, Any]]:
    return str(file), seed, tables


def _fault(*args: Any, **fields: Any) -> dict[str, Any]:
    from benchctl_instruments.errors import UsageError

    if args:
        raise UsageError(
            f'benchctl_fault{args!r}: expected its fields by name, as benchctl_fault(on="chamber", kind="silence")'
        )
    return fields


def _changed(document: dict[str, Any], tables: dict[str, Any]) -> dict[str, Any]:
    """Return the document with its values replaced by those of `tables`, recursively."""
    return document | {
        name: _changed(document[name], value) if isinstance(value, dict) and name in document else value
        for name, value in tables.items()
    }
