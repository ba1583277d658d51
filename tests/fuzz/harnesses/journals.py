"""Journals of campaigns, as a crash or a stranger leaves them: read, mended, and gone on with."""

from __future__ import annotations

import json

from benchctl.bench import SIMULATED, load_bench
from benchctl.campaign.resume import elapsed_s
from benchctl.recordings.journal import (
    append_event,
    events_in,
    journal_text,
    last_word,
    mend_journal,
    planned_steps,
)
from tests.fuzz.harness import Harness, refusals, workplace

BENCH = load_bench(SIMULATED)


def one_input(data: bytes) -> None:
    journal = workplace() / "journal.jsonl"
    journal.write_bytes(data)
    with refusals():
        text = journal_text(journal)
        status, reason = last_word(events_in(text))
        planned_steps(events_in(text))
        elapsed_s(BENCH, [], events_in(text))
        elapsed_s(BENCH.model_copy(update={"simulated": False}), [], events_in(text))
        mend_journal(journal)
        mended = journal.read_bytes()
        mend_journal(journal)
        assert journal.read_bytes() == mended
        append_event(journal, "recover", {"status": status, "reason": reason})
        lines = journal.read_bytes().decode("utf-8").split("\n")
        assert lines.pop() == ""
        assert all(isinstance(json.loads(line), dict) for line in lines)
        assert last_word(events_in(journal_text(journal))) == (status, reason)


def seeds() -> list[bytes]:
    events = [
        {"kind": "prepared", "bench_s": 0.0, "planned": 3},
        {"kind": "step", "bench_s": 0.5, "index": 1, "name": "Ruhe bei −20 °C"},
        {"kind": "whole", "index": 1, "samples": 100, "digest": "0" * 64},
        {"kind": "safe", "status": "aborted", "reason": "the disk is full", "bench_s": 12.5, "problems": []},
        {"kind": "resume", "elapsed_s": 20.0, "day": 1},
        {"kind": "guard", "says": "taking over"},
        {"kind": "finish", "status": "complete", "reason": ""},
    ]
    stamped = [{"wall_time": "2026-11-21T10:00:00+00:00", **event} for event in events]
    text = "".join(f"{json.dumps(event, ensure_ascii=False)}\n" for event in stamped).encode()
    return [text, text[:-30], b"".join(reversed(text.splitlines(keepends=True)))]


HARNESS = Harness(
    name="journals",
    weight=40,
    one_input=one_input,
    seeds=seeds,
    tokens=(
        b'"kind": ',
        b'"status": "interrupted"',
        b'"reason": ',
        b'"planned": ',
        b'"bench_s": 1e400',
        b'"bench_s": NaN',
        b'"wall_time": "',
        b'"wall_time": "0001-01-01T00:00:00+23:59"',
        b"\\ud800",
        b"\\u2028",
        b"[" * 70,
        b"9" * 60,
        b"\r\n",
        b"\n\n",
        b"\xff",
    ),
)
