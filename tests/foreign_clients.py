"""Programs by others against the simulated instruments: `python -m tests.foreign_clients` runs them and prints a table.

A test of such a program carries the marker `foreign_client(instrument, client, does, package="")`: the model, the
program (empty: the id of the test's parameters), what it does, and the package that is installed and runs unchanged.
Without a package the program's calls are replayed from its public source, the client's name. The table ends with the
models that no such test covers.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, get_args

import pytest

from benchctl_instruments.catalog import MANUAL, Kind, our_models

_NAMES = {"passed": "yes", "failed": "**no**", "skipped": "not run"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """What one test showed of a client and an instrument."""

    instrument: str
    client: str
    does: str
    package: str
    outcome: str

    @property
    def how(self) -> str:
        """The version of the package that ran, or that its calls were replayed."""
        if not self.package:
            return "calls replayed"
        try:
            return f"{self.package} {version(self.package)}"
        except PackageNotFoundError:
            return self.package


class Collector:
    """A plug-in of pytest that keeps what each marked test showed."""

    def __init__(self) -> None:
        self.tried: list[Tried] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        if report.when == "call" or not report.passed:
            for marker in item.iter_markers("foreign_client"):
                self.tried.append(tried(*marker.args, outcome=report.outcome, item=item, **marker.kwargs))
        return report


def tried(instrument: str, client: str, does: str, *, outcome: str, item: Any, package: str = "") -> Tried:
    return Tried(instrument=instrument, client=client or item.callspec.id, does=does, package=package, outcome=outcome)


def table(found: Sequence[Tried]) -> Iterator[str]:
    """Yield the lines of the table: an instrument and a client a row."""
    yield "| instrument | client | unchanged or replayed | what it does | works |"
    yield "|---|---|---|---|---|"
    for kind in get_args(Kind):
        for model in our_models(kind):
            of_model = [one for one in found if one.instrument == model]
            for client, how in dict.fromkeys((one.client, one.how) for one in of_model):
                own = [one for one in of_model if (one.client, one.how) == (client, how)]
                does = "; ".join(dict.fromkeys(one.does for one in own))
                worst = next(name for name in ("failed", "skipped", "passed") if name in {one.outcome for one in own})
                yield f"| `{model}` | {client} | {how} | {does} | {_NAMES[worst]} |"
            if not of_model:
                yield f"| `{model}` | {'no wire' if model == MANUAL else 'none by others was run'} | | | |"


def main() -> int:
    """Run the tests, whose own output goes to stderr, and print the table."""
    collector = Collector()
    with contextlib.redirect_stdout(sys.stderr):
        status = pytest.main(["-q", "-m", "foreign_client", "tests/instruments"], plugins=[collector])
    print("\n".join(table(collector.tried)))  # noqa: T201 - what this is for
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
