"""A fault at every single request of a driver's dialogue: whichever it befalls, nothing wrong is taken for right."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.instruments.faults import kinds
from tests.instruments.faults.cells import NeverHappenedError, Outcome, befallen
from tests.instruments.faults.rows import ROWS, Row

FAULTS = ("cut", "half a float", "junk in", "lost request", "late answer", "refusal")
MOST = 80  # the digitizer's dialogue repeats itself from there on
AT_ONCE = 4  # each mostly waits for a silent line


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("row", [row for row in ROWS if not row.like], ids=str)
def test_whichever_request_is_befallen_it_recovers_or_stops(row: Row, fault: str) -> None:
    def outcome_of(nth: int) -> Outcome | None:
        """None: the dialogue has fewer requests."""
        try:
            return befallen(row, kinds.LINK[fault](on=row.kind, nth=nth))
        except NeverHappenedError:
            return None

    with ThreadPoolExecutor(AT_ONCE) as side_by_side:
        for first in range(1, MOST + 1, AT_ONCE):
            some = range(first, first + AT_ONCE)
            for nth, outcome in zip(some, side_by_side.map(outcome_of, some), strict=True):
                if outcome is None:
                    assert nth > 10
                    return
                assert "\n" not in outcome.why
                if outcome.what == "cannot happen":
                    return
