import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.recordings.journal import append_event, events_in, journal_text, last_word, mend_journal

LINE = '{"kind": "step", "wall_time": "2026-11-21T10:00:00+00:00", "index": 2, "name": "Soak bei −20 °C\u2028"}'


def test_an_event_is_a_line_of_json_with_its_time(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    append_event(journal, "step", {"index": 1, "name": "Ö"})
    append_event(journal, "whole", {"index": 1})
    first, second = (json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines())
    assert (first["kind"], first["index"], first["name"], second["kind"]) == ("step", 1, "Ö", "whole")
    assert first["wall_time"] <= second["wall_time"]


@pytest.mark.parametrize("length", range(len(LINE.encode()) + 1))
def test_every_prefix_of_the_last_line_is_read_and_mended_and_no_byte_of_it_is_lost(
    tmp_path: Path, length: int
) -> None:
    journal = tmp_path / "journal.jsonl"
    append_event(journal, "begin", {})
    torn = LINE.encode()[:length]
    journal.write_bytes(journal.read_bytes() + torn)
    whole = length == len(LINE.encode())
    assert [event["kind"] for event in events_in(journal_text(journal))] == ["begin"] + ["step"] * whole
    mend_journal(journal)
    mended = journal.read_bytes()
    mend_journal(journal)
    assert journal.read_bytes() == mended
    append_event(journal, "after", {})
    events = [json.loads(line) for line in journal.read_text(encoding="utf-8").split("\n")[:-1]]
    middle = ["step"] if whole else ["torn"] if length else []
    assert [event["kind"] for event in events] == ["begin", *middle, "after"]
    if middle == ["torn"]:
        assert events[1]["text"] == torn.decode("utf-8", errors="replace")


@given(st.binary(max_size=200))
def test_a_journal_of_any_bytes_becomes_json_in_every_line(
    tmp_path_factory: pytest.TempPathFactory, junk: bytes
) -> None:
    journal = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    journal.write_bytes(junk)
    mend_journal(journal)
    lines = journal.read_bytes().decode("utf-8").split("\n")
    assert lines.pop() == ""
    assert all(isinstance(json.loads(line), dict) for line in lines)
    assert len(events_in(journal_text(journal))) == len(lines)


def test_a_journal_that_is_not_there_yet_is_begun(tmp_path: Path) -> None:
    mend_journal(tmp_path / "journal.jsonl")
    assert journal_text(tmp_path / "journal.jsonl") == ""
    assert journal_text(tmp_path / "nowhere.jsonl") == ""


STEP = {"kind": "step", "wall_time": "10:00"}
FULL = {"kind": "finish", "status": "aborted", "reason": "the disk is full"}


@pytest.mark.parametrize(
    ("events", "word"),
    [
        ([], ("aborted", "its program died, before anything happened")),
        ([STEP], ("aborted", "its program died, last heard of at 10:00")),
        ([STEP, {"kind": "guard", "wall_time": "11:00"}], ("aborted", "its program died, last heard of at 10:00")),
        ([STEP, FULL], ("aborted", "the disk is full")),
        ([STEP, {**FULL, "kind": "safe"}], ("aborted", "the disk is full")),
        ([STEP, {"kind": "finish", "status": "complete", "reason": ""}], ("complete", "")),
        (
            [STEP, FULL, {"kind": "resume", "wall_time": "12:00"}],
            ("aborted", "its program died, last heard of at 12:00"),
        ),
        (
            [STEP, {"kind": "finish", "status": "glorious"}],
            ("aborted", "its program died, last heard of at an unknown time"),
        ),
    ],
)
def test_the_last_word_of_a_program_that_is_gone(events: list[dict[str, object]], word: tuple[str, str]) -> None:
    assert last_word(events) == word
