"""The table of programs by others: what it says of tests that passed, failed, or do not exist."""

from __future__ import annotations

from importlib.metadata import version

from benchctl_instruments.catalog import Kind, our_models
from tests.foreign_clients import Tried, table


def test_a_client_works_only_if_each_of_its_tests_passed_and_every_instrument_has_a_row() -> None:
    def esp301(does: str, outcome: str, package: str = "pytest") -> Tried:
        return Tried(instrument="newport_esp301", client="A", does=does, package=package, outcome=outcome)

    rows = list(table([esp301("homes", "passed"), esp301("turns", "failed"), esp301("turns", "skipped", "")]))
    assert f"| `newport_esp301` | A | pytest {version('pytest')} | homes; turns | **no** |" in rows
    assert "| `newport_esp301` | A | calls replayed | turns | not run |" in rows
    assert "| `manual` | no wire | | | |" in rows
    kinds: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer", "gyro")
    silent = {model for kind in kinds for model in our_models(kind)} - {"newport_esp301", "manual"}
    assert {f"| `{model}` | none by others was run | | | |" for model in silent} <= set(rows)
