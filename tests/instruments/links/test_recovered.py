from __future__ import annotations

import logging
import subprocess
import sys

import pytest

from benchctl_instruments.links.wirelog import note_recovered


def test_who_listens_is_told_what_went_wrong_and_how_it_was_got_over(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        note_recovered("chamber at tcp://x: no answer within 1 s")
        note_recovered("digitizer at tcp://y: its stream broke", "connected again")
    assert caplog.messages == [
        "chamber at tcp://x: no answer within 1 s; asked again, it answered",
        "digitizer at tcp://y: its stream broke; connected again",
    ]


def test_where_nobody_listens_nothing_is_printed() -> None:
    program = "from benchctl_instruments.links.wirelog import note_recovered; note_recovered('no answer')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, timeout=50)
    assert (done.stdout, done.stderr) == (b"", b"")
