"""One voice: what a machine can hold of it over all messages, and over what real wrong command lines are told.

What tried, what came, what was expected, what to do: one line, beginning small, without a full stop, and nobody is
told off. The whole list, to be read through as one text: `python -m tests.messages`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from benchctl.cli.verbs import VERBS
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording
from tests.messages import PACKAGES, ROOT, Message, messages

_BEGINS = re.compile(r"[^A-Z]|\w*[A-Z-]\w*[A-Z0-9_]|I\b")
"""A small letter, a sign or what is filled in; or a name that is spelt with more than one capital or a digit."""

_NOT_OURS = re.compile(
    r"\b(please|sorry|oops|invalid|illegal|fail(s|ed|ure)?|errors?|unexpected|unable"
    r"|does not exist|could not find|color|center|meter|behavior|gray|\w+(?<!s)ize[ds]?|analyz\w+)\b",
    re.IGNORECASE,
)
"""Words that blame or tell nothing, other words for "there is no such", and American spelling."""

_NAMES_OF_THE_FIELD = re.compile(
    "following error|LabJack error|input error|queue of errors|code of an error|fails its limit"
)
"""What is called so by a maker's manual, or by those who accept units."""

_SAYS_MORE = re.compile(
    r"expected|; |did you mean|there (are|is) \{|it has \{|missing among"
    r"|\bneed(s|ed)?\b|at least|at most|\blimits?\b|\bmust\b"
)
"""What was expected, or what to do."""

_PASSES_ON = re.compile(r"[:,] \{[^:]*[:{].*\}$|[:,] \{…\}( \(.*\))?$|^\{…\} \(.*\)$")
"""Ends in what another message said, which is judged where that one stands."""

_BARE = {
    "stopped by {…}": "whoever stopped it knows why",
    "stopped by {…}: refused to {…}": "whoever refused knows why",
    "stopped by the operator at the terminal: refused to {…}": "whoever refused knows why",
    "no answer after {…} s": "it stands beside a trial in a proof's table",
    "{…}: nothing came within {…} s": "its callers say what was sent and what to check",
    "the time is over": "its callers say what was sent and what to check",
    "timed out before the answer was complete": "its callers say what was sent and what to check",
    "step {…} cannot be finished: step {…} is the last that was begun": "told to who writes a program",
}
"""Messages that neither say what was expected nor what to do, each with the reason."""

_SPOKEN_BY_MACHINES = ("instruments/protocols/", "instruments/simulated/", "benchctl/dashboard/")
"""Protocols whose callers say the rest, controllers that answer in their makers' words, and answers over HTTP, which
the page puts into words of its own."""


@cache
def told() -> tuple[Message, ...]:
    """All messages; to read them takes seconds."""
    return tuple(messages())


def faults_of(text: str) -> Iterator[str]:
    """What is wrong with a line, whoever says it."""
    if "\n" in text:
        yield "it is more than a line"
    if re.search(r"[^.][.!]$", text):
        yield "it ends in a full stop"
    if re.search(r"[a-z)][.!] [A-Z]", text):
        yield "it is more than one sentence"
    if not _BEGINS.match(text):
        yield "it begins with a capital"
    if found := _NOT_OURS.search(_NAMES_OF_THE_FIELD.sub("", text)):
        yield f"it says {found[0]!r}"
    if "°/s" in text:
        yield "it says °/s, all others say deg/s"


def _alone(message: Message) -> bool:
    """Whether it must be understood by itself; some errors are caught, and said with the place where they arose."""
    handed_on = ("AssertionError", "KeyError", "OSError", "StampError", "TypeError", "ValueError")
    return message.by.endswith("Error") and message.by not in handed_on


def _named(found: list[tuple[Message, str]]) -> list[str]:
    return [f"{message.path}:{message.line}: {fault}: {message.text}" for message, fault in found]


def test_every_message_keeps_to_the_voice() -> None:
    asked = "benchctl/cli/campaigns.py"  # it repeats the question that nobody could be asked, in whole sentences
    found = [
        (message, fault)
        for message in told()
        if message.is_stated and message.path != asked and message.by != "AssertionError"  # that is read in a test
        for fault in faults_of(message.text)
    ]
    assert not _named(found)


def test_every_message_says_what_was_expected_or_what_to_do() -> None:
    found = [
        (message, "it neither says what was expected nor what to do")
        for message in told()
        if _alone(message)
        and message.is_stated
        and not message.path.startswith(_SPOKEN_BY_MACHINES)
        and message.text not in _BARE
        and not _SAYS_MORE.search(message.text)
        and not _PASSES_ON.search(message.text)
    ]
    assert not _named(found)


def test_every_exception_to_that_is_still_needed() -> None:
    assert not _BARE.keys() - {message.text for message in told()}


def test_no_message_is_a_bare_word_or_two() -> None:
    found = [
        (message, "it has fewer than four words")
        for message in told()
        if _alone(message)
        and message.is_stated
        and not message.path.startswith(_SPOKEN_BY_MACHINES)
        and message.text not in _BARE
        and not _PASSES_ON.search(message.text)
        and len(message.text.split()) < 4
    ]
    assert not _named(found)


def test_the_list_has_every_file_that_raises_something() -> None:
    listed = {message.path for message in told()}
    raising = re.compile(r"^\s+raise \w+(Error|Refusal)\((?!\))", re.MULTILINE)
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    missing = {path.relative_to(ROOT).as_posix() for path in files if raising.search(path.read_text(encoding="utf-8"))}
    assert not missing - listed
    assert {path.split("/")[0] for path in listed} >= {"benchctl", "instruments"}


def test_the_list_shows_the_words_of_nearly_all_errors() -> None:
    errors = [message for message in told() if _alone(message) and not message.path.startswith(_SPOKEN_BY_MACHINES)]
    assert sum(message.is_stated for message in errors) > 0.9 * len(errors)


def test_words_that_are_put_together_elsewhere_in_a_file_are_shown(tmp_path: Path) -> None:
    from tests.messages import _Reader

    source = """
_ADVICE = "check the cable"
def _why(size):
    return f"{size} bytes are there" if size else "it is empty"
def read(path):
    size = path.stat().st_size
    says = f"{path}: cut short: {_why(size)}; {_ADVICE}"
    raise UsageError(says)
"""
    reader = _Reader("a.py", ast.parse(source))
    reader.visit(ast.parse(source))
    (message,) = reader.found
    assert message.text == "{…}: cut short: {{…} bytes are there | it is empty}; {check the cable}"
    assert (message.by, message.line, message.is_error, message.is_stated) == ("UsageError", 8, True, True)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("bench.toml: cannot be read.", "full stop"),
        ("cannot be read\nat all", "more than a line"),
        ("Cannot be read", "capital"),
        ("it cannot be read. Look at it", "more than one sentence"),
        ("an invalid value", "'invalid'"),
        ("reading it failed", "'failed'"),
        ("initialize it first", "'initialize'"),
        ("asked for 5 °/s", "deg/s"),
    ],
)
def test_a_line_in_another_voice_is_found(text: str, fault: str) -> None:
    assert any(fault in found for found in faults_of(text))


@pytest.mark.parametrize(
    "text", ["HDF5 cannot open it", "a.h5: is no recording; name one", "K0_v_per_dps is 0", "-p a: b"]
)
def test_a_line_in_our_voice_passes(text: str) -> None:
    assert not list(faults_of(text))


WRONG = {
    "no verb": ["calibrat"],
    "a synonym of a verb": ["rerun"],
    "an option before the verb": ["--quiet", "run"],
    "init: a bench is there": ["init", "."],
    "init: below a file": ["init", "text.h5/lab"],
    "doctor: no such option": ["doctor", "--bnch", "bench.toml"],
    "instrument: no address": ["instrument", "probe", "/dev/ttyUSB0"],
    "instrument: no such kind": ["instrument", "new", "gyro", "acme"],
    "instrument: a name that is taken": ["instrument", "new", "chamber", "watlow_f4"],
    "procedures: no bench": ["procedures", "--bench", "nowhere.toml"],
    "check: no procedure": ["check", "twostage", "--bench", "simulated"],
    "check: beyond a limit": ["check", "rate_sweep", "--bench", "simulated", "-p", "top_rate_dps=400", "-q"],
    "check: a picture of no kind": ["check", "static", "--bench", "simulated", "--picture", "plan.txt", "-q"],
    "run: nothing to run": ["run"],
    "run: no bench": ["run", "static", "--bench", "nowhere.toml"],
    "run: a bench that is a folder": ["run", "static", "--bench", "empty"],
    "run: a bench with a wrong field": ["run", "static", "--bench", "wrong.toml"],
    "run: a bench that is no TOML": ["run", "static", "--bench", "text.h5"],
    "run: no parameter of that name": ["run", "two_stage", "--bench", "simulated", "-p", "point=5"],
    "run: a parameter that is no number": ["run", "two_stage", "--bench", "simulated", "-p", "points=five"],
    "run: a parameter twice": ["run", "static", "--bench", "simulated", "-p", "at_c=1", "-p", "at_c=2"],
    "run: a procedure's file that is not there": ["run", "nowhere.py", "--bench", "simulated"],
    "run: a procedure's file that breaks": ["run", "broken.py", "--bench", "simulated"],
    "run: resume what is no campaign": ["run", "static", "--bench", "simulated", "--resume", "empty"],
    "run: again what says nothing": ["run", "--again", "a.h5"],
    "run: no such option": ["run", "static", "--bench", "simulated", "--sed", "3"],
    "run: a seed below 0": ["run", "static", "--bench", "simulated", "--seed", "-1"],
    "serve: no such port": ["serve", "--port", "99999"],
    "recover: no campaign": ["recover", "empty"],
    "notify: no recipients": ["notify", "--test", "--bench", "simulated"],
    "show: no file": ["show", "nowhere.h5"],
    "show: no HDF5": ["show", "text.h5"],
    "show: cut short": ["show", "cut.h5"],
    "fit: at rest only": ["fit", "a.h5"],
    "fit: no recording": ["fit"],
    "allan: no channel": ["allan", "a.h5", "--channel", "gyro_w"],
    "allan: nothing changes": ["allan", "a.h5"],
    "allan: no rate": ["allan", "table.csv"],
    "diagnose: no model": ["diagnose", "a.h5"],
    "diagnose: no part": ["diagnose", "a.h5", "--part", "motor"],
    "compare: one alone": ["compare", "a.h5"],
    "apply: no coefficients": ["apply", "a.h5", "--coefficients", "brace.json"],
    "explain: no term": ["explain", "nothing_of_that_name"],
    "help: no topic": ["help", "nothing_of_that_name"],
    "accept: no limits": ["accept", "a.h5", "--limits", "nowhere.toml"],
    "accept: a limit of nothing": ["accept", "a.h5", "--limits", "limits.toml"],
    "verify: no file": ["verify", "nowhere.h5"],
    "history: no campaign": ["history", "empty"],
    "simulate: into a folder": ["simulate", "static", "--bench", "simulated", "-o", "empty"],
    "simulate: no such folder": ["simulate", "static", "--bench", "simulated", "-o", "nowhere/b.h5"],
    "sim: no bench": ["sim", "--bench", "nowhere.toml"],
    "fleet: no such verb": ["fleet", "calibrate", "a.h5"],
    "fleet: no recording": ["fleet", "fit", "empty"],
    "fleet: no limits": ["fleet", "accept", "a.h5"],
    "fleet: no scheduler": ["fleet", "fit", "a.h5", "--scheduler", "nowhere:x"],
    "import: no map": ["import", "table.csv", "-o", "b.h5"],
    "import: a wrong map": ["import", "table.csv", "--map", "map.toml", "-o", "b.h5"],
    "import: over another file": ["import", "table.csv", "-o", "a.h5"],
    "export: no such kind": ["export", "a.h5", "--to", "xls"],
    "prove: no class": ["prove", "--only", "nothing_of_that_name", "--out", "proof"],
    "paper: no folder": ["paper", "--out", "text.h5/paper"],
    "json: into no folder": ["show", "a.h5", "--json", "nowhere/a.json"],
}
"""What goes wrong -> the command line, in a folder with the files below."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the command lines name."""
    folder = tmp_path_factory.mktemp("wrong")
    info = StepInfo(index=1, name="rest", kind="static", t_start=0.0, t_end=1.0, chamber_setpoint_c=20.0)
    times_s = np.arange(100) / 100.0
    channels = {"time_s": times_s, "encoder_deg": np.zeros(100), "gyro_v": np.zeros(100), "gyro_temp_c": times_s + 20.0}
    meta = Meta(status="complete", unit=Unit(serial="1", range_dps=100.0), bench=BenchFacts(sample_rate_hz=100.0))
    write_recording(folder / "a.h5", meta, [Step(info, channels)])
    (folder / "cut.h5").write_bytes((folder / "a.h5").read_bytes()[:-2000])
    (folder / "empty").mkdir()
    for name, text in {
        "bench.toml": template(),
        "wrong.toml": template().replace("range_dps = 175.0", "range_dps = 'fast'"),
        "text.h5": "not HDF5 at all\n",
        "table.csv": "out\n1.0\n2.0\n",
        "map.toml": "[time]\ncolumn = 't'\n",
        "limits.toml": "[limits.nothing_of_that_name]\nhigh = 1.0\nunit = 'deg/h'\n",
        "brace.json": "{",
        "broken.py": "import nothing_of_that_name\n",
    }.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def _content(folder: Path) -> dict[str, bytes | None]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")
    }


@pytest.mark.parametrize("arguments", WRONG.values(), ids=WRONG.keys())
def test_a_wrong_command_line_gets_one_line_and_leaves_nothing_behind(
    arguments: list[str], written: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(written)
    before = _content(written)
    status = run_verb(arguments)
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    assert err.endswith("\n")
    assert err.startswith("benchctl: ")
    line = err[len("benchctl: ") : -1]
    assert not list(faults_of(line)), line
    assert len(line.split()) > 3
    assert re.search(r"expected|; |did you mean|need|: (?!.*: )", line), line
    assert _content(written) == before


def test_every_verb_is_among_the_wrong_command_lines() -> None:
    assert not VERBS.keys() - {arguments[0] for arguments in WRONG.values()}
