"""A fault at every single request of a driver's dialogue: whichever it befalls, nothing wrong is taken for right."""

from __future__ import annotations

import itertools

import pytest

from tests.instruments.faults import kinds
from tests.instruments.faults.cells import NeverHappenedError, befallen
from tests.instruments.faults.rows import ROWS, Row

FAULTS = ("cut", "half a float", "junk in", "lost request", "late answer", "refusal")
MOST = 80  # the digitizer's dialogue repeats itself from there on


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("row", [row for row in ROWS if not row.like], ids=str)
def test_whichever_request_is_befallen_it_recovers_or_stops(row: Row, fault: str) -> None:
    for nth in itertools.count(1):
        try:
            outcome = befallen(row, kinds.LINK[fault](on=row.kind, nth=nth))
        except NeverHappenedError:
            assert nth > 10
            return
        assert "\n" not in outcome.why
        if nth == MOST or outcome.what == "cannot happen":
            return
