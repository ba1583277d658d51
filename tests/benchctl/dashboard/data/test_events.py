"""The journal in words: a stretch at a time, from a folder or from a recording, whatever is in it."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.dashboard.data.events import MOST_EVENTS, events_after, sentence_of
from benchctl.dashboard.data.follower import JournalTail
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.journal import mend_journal
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


def _journal(folder: Path, events: list[dict[str, Any]], end: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "journal.jsonl").write_text("".join(f"{json.dumps(event)}\n" for event in events) + end)
    return folder


@pytest.mark.parametrize(
    ("event", "says", "level"),
    [
        ({"kind": "prepared", "planned": 3, "instruments": {"rate_table": {}, "chamber": {}}},
         "ready: 3 steps planned; rate table, chamber answered", "info"),
        ({"kind": "step", "index": 9, "number": 2, "name": "rate +5"}, "step 2 begins: rate +5", "info"),
        ({"kind": "step", "index": 9, "name": "rate +5"}, "step 9 begins: rate +5", "info"),
        ({"kind": "whole", "index": 2, "name": "x", "samples": 30000}, "step 2 is complete: x, 30,000 samples", "info"),
        ({"kind": "gap", "time_s": 12.5, "scans": 40},
         "gap in the stream at 12.5 s: 40 scans are missing", "warning"),
        ({"kind": "silence", "instrument": "rate_table", "says": "no answer"},
         "rate table is silent: no answer", "warning"),
        ({"kind": "interlock", "says": "air_c above 80", "on": True, "value": 80.5, "action": "stop"},
         "interlock: air_c above 80 (80.5), action stop", "bad"),
        ({"kind": "hold", "on": True, "says": "air_c above 80"},
         "on hold, the table at rest: air_c above 80", "warning"),
        ({"kind": "waiting", "says": "mount across", "by": "A. Ivanova"},
         "waiting for A. Ivanova: mount across", "warning"),
        ({"kind": "notify", "says": "no message to mailto://…"}, "no message to mailto://…", "warning"),
        ({"kind": "safe", "problems": ["rate_table: no answer"]},
         "NOT KNOWN TO BE AT REST: rate_table: no answer", "bad"),
        ({"kind": "safe", "problems": [], "rate_dps": 0.0, "chamber_setpoint_c": 23.0},
         "at rest, read back: table at 0 deg/s, chamber set to 23 °C", "info"),
        ({"kind": "finish", "status": "complete", "reason": ""}, "complete", "info"),
        ({"kind": "finish", "status": "interrupted", "reason": "stopped by Ctrl-C"},
         "interrupted: stopped by Ctrl-C", "warning"),
        ({"kind": "finish", "status": "aborted", "reason": "why"}, "aborted: why", "bad"),
        ({"kind": "guard", "says": "process 7 guards the run"}, "guard: process 7 guards the run", "info"),
        ({"kind": "guard", "says": "it died; table at rest", "problems": []},
         "guard: it died; table at rest", "warning"),
        ({"kind": "news", "says": "from a later version"}, "from a later version", "info"),
        ({"kind": "some_thing"}, "some thing", "info"),
    ],
)  # fmt: skip
def test_events_are_told_in_words(event: dict[str, Any], says: str, level: str) -> None:
    assert sentence_of(event) == (says, level)


plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
json_values = st.recursive(plain, lambda one: st.lists(one, max_size=3), max_leaves=4)


@given(
    st.sampled_from(["prepared", "resume", "step", "whole", "cut", "gap", "frames_lost", "silence", "recovered",
                     "gyro_fault", "interlock", "hold", "operator", "guard", "safe", "finish", "recover", "torn",
                     "unreadable", "certificate", "notify", "waiting", "plan", "other"]),
    st.dictionaries(
        st.sampled_from(["says", "index", "number", "name", "samples", "on", "value", "problems", "rate_dps", "status",
                         "reason", "planned", "instruments", "instrument", "time_s", "scans", "by", "waited_s"]),
        json_values,
    ),
)  # fmt: skip
def test_whatever_an_event_holds_it_is_one_line_of_plain_text(kind: str, data: dict[str, Any]) -> None:
    found = sentence_of({**data, "kind": kind})
    assert (found is None) == (kind == "plan")
    if found is not None:
        assert found[0].isprintable()
        assert len(found[0]) <= 400
        assert found[1] in ("info", "warning", "bad")


def test_events_come_by_stretches_and_are_numbered_by_their_lines(tmp_path: Path) -> None:
    steps = [{"kind": "plan", "of": 0}, *({"kind": "step", "number": n, "name": "x"} for n in range(1200))]
    folder = _journal(tmp_path / "c", steps, end='{"kind": "torn of')
    first = events_after(folder, 0)
    assert (len(first["events"]), first["events"][0]["number"], first["next"]) == (MOST_EVENTS, 2, MOST_EVENTS + 1)
    second = events_after(folder, first["next"])
    third = events_after(folder, second["next"])
    assert [len(one["events"]) for one in (second, third)] == [MOST_EVENTS, 200]
    assert third["next"] == 1201
    assert events_after(folder, 1201) == {"events": [], "next": 1201}
    assert first["events"][0] == {
        "number": 2, "wall_time": "", "kind": "step", "says": "step 0 begins: x", "level": "info",
    }  # fmt: skip


def test_the_journal_that_a_recording_keeps_is_told_where_there_is_no_other(tmp_path: Path) -> None:
    journal = '{"kind": "finish", "status": "complete", "wall_time": "2026-11-20T18:00:00+00:00"}\n'
    path = tmp_path / "one.h5"
    write_recording(path, made.meta(provenance={"journal": journal}), made.steps(1))
    (event,) = events_after(path, 0)["events"]
    assert (event["says"], event["wall_time"]) == ("complete", "2026-11-20T18:00:00+00:00")


def test_lines_that_are_no_events_are_passed_over_and_counted(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / "journal.jsonl").write_bytes(b'[1]\nnonsense \xff\n{"kind": "recovered", "says": "a"}\n' + b"[" * 900)
    found = events_after(folder, 0)
    assert [event["number"] for event in found["events"]] == [3]


def test_a_recording_that_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no such file"):
        events_after(tmp_path / "none.h5", 0)


def test_a_growing_journal_is_read_line_by_line_each_once(tmp_path: Path) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    tail = JournalTail(tmp_path / "c")
    assert tail.new_lines() == []
    writer.event("step", index=1)
    writer.event("whole", index=1)
    assert [(number, event and event["kind"]) for number, event in tail.new_lines()] == [(1, "step"), (2, "whole")]
    assert tail.new_lines() == []
    with (tmp_path / "c" / "journal.jsonl").open("a") as file:
        file.write('{"kind": "st')
        file.flush()
        assert tail.new_lines() == []
        file.write('ep"}\nnonsense\n')
    assert tail.new_lines() == [(3, {"kind": "step"}), (4, None)]
    assert tail.lines == 4
    writer.release()


def test_a_journal_that_was_mended_goes_on_where_it_was(tmp_path: Path) -> None:
    folder = _journal(tmp_path / "c", [{"kind": "step"}], end='{"kind": "st')
    tail = JournalTail(folder)
    assert len(tail.new_lines()) == 1
    mend_journal(folder / "journal.jsonl")
    ((number, event),) = tail.new_lines()
    assert (number, event and event["kind"]) == (2, "torn")


def test_a_journal_that_began_anew_is_read_from_its_beginning(tmp_path: Path) -> None:
    folder = _journal(tmp_path / "c", [{"kind": "step"}] * 3)
    tail = JournalTail(folder)
    assert len(tail.new_lines()) == 3
    (folder / "journal.jsonl").unlink()
    assert tail.new_lines() == []
    _journal(folder, [{"kind": "whole"}])
    assert tail.new_lines() == [(1, {"kind": "whole"})]
