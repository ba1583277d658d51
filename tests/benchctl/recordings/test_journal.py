import json
import os
import time
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.limits import MOST_JOURNAL_BYTES, MOST_JOURNAL_LINES, MOST_LINE_BYTES
from benchctl.recordings.journal import (
    append_event,
    events_in,
    journal_text,
    last_word,
    mend_journal,
    planned_steps,
)
from benchctl_instruments.errors import UsageError
from tests.slowness import slowness

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
    assert len(list(events_in(journal_text(journal)))) == len(lines)


def test_bytes_that_are_no_character_in_a_whole_line_are_replaced(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(b'{"kind": "step", "name": "so\xe4k"}\n')
    mend_journal(journal)
    assert json.loads(journal.read_text(encoding="utf-8")) == {"kind": "step", "name": "so\ufffdk"}


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


@pytest.mark.parametrize(
    ("event", "says"),
    [
        ({**FULL, "reason": "two\nlines \x1b[31m\ud800"}, "two lines  [31m "),
        ({**FULL, "reason": ["a", {"b": 1}]}, "['a', {'b': 1}]"),
        ({"kind": "step", "wall_time": "x" * 5000}, "its program died, last heard of at " + "x" * 1997 + "..."),
        ({"kind": ["step"], "status": {}}, "its program died, last heard of at an unknown time"),
    ],
)
def test_a_last_word_can_be_printed_and_stored_whatever_it_was(event: dict[str, object], says: str) -> None:
    assert last_word([event]) == ("aborted", says)


@pytest.mark.parametrize(
    ("said", "planned"),
    [([], None), ([12], 12), ([12, 7], 7), ([12, "many"], 12), ([12, 0, -1, 10**15, 2.5], 12), ([10**15], None)],
)
def test_how_many_steps_were_planned_is_what_a_program_could_have_meant(
    said: list[object], planned: int | None
) -> None:
    assert planned_steps([{"kind": "step"}, *({"planned": one} for one in said)]) == planned


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_in_place_of_a_journal_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "journal.jsonl")
    for use in (journal_text, mend_journal):
        with pytest.raises(UsageError, match=r"^journal .*journal\.jsonl: cannot be read: it is no file; name one$"):
            use(tmp_path / "journal.jsonl")


def test_a_folder_in_place_of_a_journal_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"^journal .*: cannot be read: it is no file; name one$"):
        journal_text(tmp_path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\0" * (MOST_JOURNAL_BYTES + 1), "is larger than 67 MB, which no such file needs"),
        (b"\n" * (MOST_JOURNAL_LINES + 1), "524289 lines, expected at most 524288; move it away"),
    ],
)
def test_a_journal_that_no_campaign_writes_is_refused_and_left_alone(tmp_path: Path, content: bytes, says: str) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(content)
    with pytest.raises(UsageError, match=says):
        mend_journal(journal)
    assert journal.stat().st_size == len(content)


@pytest.mark.parametrize("deep", ["[" * 100_000, '{"a": ' * 500 + "1" + "}" * 500, '{"kind": ' + "9" * 5000 + "}"])
def test_a_line_that_is_nested_too_deep_or_too_wide_is_no_event_and_is_kept_as_text(tmp_path: Path, deep: str) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_text(f"{deep}\n", encoding="utf-8")
    append_event(journal, "after", {})
    assert [event["kind"] for event in events_in(journal_text(journal))] == ["after"]
    mend_journal(journal)
    torn, after = events_in(journal_text(journal))
    assert (torn["kind"], torn["text"], after["kind"]) == ("torn", deep, "after")


def test_a_line_that_is_too_long_becomes_events_that_are_not_and_no_character_is_lost(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    long = "\x01Ö" * (MOST_LINE_BYTES // 2)
    journal.write_text(f'{{"kind": "{long}"}}\n', encoding="utf-8")
    mend_journal(journal)
    mended = journal.read_bytes()
    assert max(map(len, mended.decode("utf-8").split("\n"))) < MOST_LINE_BYTES
    assert "".join(event["text"] for event in events_in(journal_text(journal))) == f'{{"kind": "{long}"}}'
    mend_journal(journal)
    assert journal.read_bytes() == mended


def test_events_take_the_memory_of_one_however_many_there_are() -> None:
    text = ('{"kind": "step", "a": [' + "{}," * 1000 + "1]}\n") * 12
    tracemalloc.start()
    assert last_word(events_in(text))[0] == "aborted"
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500_000


def test_a_long_journal_is_read_in_time() -> None:
    text = f"{LINE}\n" * 20_000
    begun = time.process_time()
    assert sum(1 for _ in events_in(text)) == 20_000
    assert time.process_time() - begun < 2.0 * slowness()
