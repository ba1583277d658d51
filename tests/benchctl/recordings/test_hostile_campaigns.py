"""Folders of campaigns that no campaign would leave: one clear line, or read for what they are worth."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.schema import JOURNAL
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.slowness import slowness


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign whose program died before its first step."""
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    writer.event("prepared", planned=2)
    writer.release()
    return tmp_path / "c"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_in_place_of_the_journal_is_told_and_the_campaign_recovers_without_it(folder: Path) -> None:
    (folder / JOURNAL).unlink()
    os.mkfifo(folder / JOURNAL)
    for use in (open_recording, recover):
        with pytest.raises(UsageError, match=r"^journal .*journal\.jsonl: cannot be read: it is no file; name one$"):
            use(folder)
    (folder / JOURNAL).unlink()
    assert recover(folder).status == "aborted"


@pytest.mark.parametrize(
    ("line", "status", "reason"),
    [
        ('{"kind": "prepared", "planned": 1000000000000000}', "aborted", "its program died, last heard of at "),
        (
            '{"kind": "finish", "status": "complete", "planned": 500000}',
            "aborted",
            "of the planned steps 1, 2, 3, 4, 5, ",
        ),
        ('{"kind": "finish", "status": "aborted", "reason": "\\ud800\\u001b[2J\\n"}', "aborted", "  [2J "),
        ('{"kind": "step", "a": ' + "[" * 100_000, "aborted", "its program died, last heard of at "),
    ],
)
def test_a_campaign_with_such_a_line_in_its_journal_is_closed(
    folder: Path, line: str, status: str, reason: str
) -> None:
    with (folder / JOURNAL).open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")
    begun = time.process_time()
    recovered = recover(folder)
    assert time.process_time() - begun < 2.0 * slowness()
    assert recovered.status == status
    assert recovered.reason.startswith(reason)
    assert len(recovered.reason) < 200
    with open_recording(folder) as recording:
        assert recording.meta.provenance["reason"] == recovered.reason
