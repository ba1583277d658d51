"""Reports on recordings whose provenance says what no program of ours writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.reader import open_recording
from benchctl.reports.results import source_digest
from benchctl.reports.setup_section import instruments, parameters, provenance
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

HOSTILE = ("[" * 100_000, '{"a": ' + "9" * 5000 + "}", "{", "7", '"' + "x" * 100_000 + '"')


@pytest.mark.parametrize("text", HOSTILE)
def test_a_text_that_is_no_table_is_shown_as_it_is_and_in_short(text: str) -> None:
    meta = made.meta(provenance={"parameters": text, "instruments": text, "software": text})
    [(name, value)] = parameters(meta).items()
    assert name == "as recorded"
    assert str(value)[:400] == text[:400]
    assert len(str(value)) <= 500
    assert [one.role for one in instruments(meta)] == ["as recorded"]
    assert [name for name, _ in provenance(meta, "abc")] == ["Recording, SHA-256", "as recorded"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 100_000, ": nested too deep"),
        ("{", ", line 1: not JSON"),
        ("7", ": expected a SHA-256 by each name, got 7; import them again"),
        ('{"a.csv": {"bytes": 5}}', ": expected a SHA-256 by each name, got {'a.csv'"),
        ('{"a.csv": "abc"}', ": expected a SHA-256 by each name, got {'a.csv'"),
    ],
)
def test_sources_that_are_none_are_told_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running", provenance={"sources": text}))
    writer.release()
    with open_recording(tmp_path / "c") as recording, pytest.raises(UsageError) as caught:
        source_digest(recording)
    assert str(caught.value).startswith(f"the sources that {tmp_path / 'c'} names{says}")


def test_sources_are_told_by_their_digests(tmp_path: Path) -> None:
    told = json.dumps({"a.csv": {"sha256": "ab"}, "b.csv": {"sha256": "cd"}})
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running", provenance={"sources": told}))
    writer.release()
    with open_recording(tmp_path / "c") as recording:
        assert source_digest(recording) == "ab cd"
