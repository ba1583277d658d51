"""Whoever does what no instrument can: nobody, somebody at a terminal; over the wires of a bench at addresses."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.campaign.opened import open_bench
from benchctl.campaign.operator import NoOperator, TerminalOperator, operator_at_terminal
from benchctl.campaign.runner import run_campaign
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import SafetyError, UsageError
from benchctl_instruments.interfaces import TableState
from tests.benchctl.campaign.by_hand import BENCH, PLAN, PROCEDURE, REST, done, events, plan_of
from tests.benchctl.cli.processes import simulated_servers

needs_a_pty = pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")


def test_where_nobody_is_a_plan_that_needs_somebody_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with open_bench(BENCH, wires=False) as opened:
        alone = replace(opened, operator=NoOperator())
        with pytest.raises(UsageError) as caught:
            run_campaign(PLAN, alone, tmp_path / "c")
        assert str(caught.value) == (
            "procedure mine, step 3: power cycle: needs an operator, and there is none; run it at a "
            "terminal (stdin and stderr), with --answers FILE, or on a bench with simulated = true; benchctl check "
            "lists the questions"
        )
        assert not (tmp_path / "c").exists()
        assert opened.table.state() is TableState.DISABLED
        assert run_campaign(plan_of(REST), alone, tmp_path / "d").status == "complete"


def test_without_an_operator_nothing_is_done() -> None:
    for act in (lambda: NoOperator().power(False, lambda: None), lambda: NoOperator().mount("across", lambda: None)):
        with pytest.raises(SafetyError, match="by an operator; run it at a terminal"):
            act()


def test_without_a_terminal_nobody_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not operator_at_terminal(BENCH).who
    monkeypatch.setattr(sys, "stdin", None)
    assert not operator_at_terminal(BENCH).who


@contextmanager
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """stdin and stderr of this process on a pty; yields the other end."""
    import pty

    ours, theirs = pty.openpty()
    with (
        os.fdopen(theirs, "r", closefd=True) as stdin,
        os.fdopen(os.dup(theirs), "w") as stderr,
        monkeypatch.context() as patched,
    ):
        patched.setattr(sys, "stdin", stdin)
        patched.setattr(sys, "stderr", stderr)
        yield ours


def _read_until(ours: int, words: bytes) -> bytes:
    seen = b""
    while words not in seen:
        seen += os.read(ours, 4096)
    return seen


@needs_a_pty
def test_an_operator_is_told_what_to_do_and_answers_with_enter(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as ours:
        operator = operator_at_terminal(BENCH.model_copy(update={"operator": "A. Ohm"}))
        assert operator.who == "A. Ohm, at the terminal"
        looks: list[float] = []
        typing = threading.Thread(target=lambda: (_read_until(ours, b"Enter."), time.sleep(0.3), os.write(ours, b"\n")))
        os.write(ours, b"\n")  # from before the question: no answer
        typing.start()
        operator.mount("across", lambda: (looks.append(time.monotonic()), time.sleep(0.02))[0])
        typing.join()
        assert looks[-1] - looks[0] > 0.2
    os.close(ours)


@needs_a_pty
def test_the_question_names_the_unit_and_what_is_to_be_done(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[bytes] = []

    def answer(ours: int) -> None:
        seen.append(_read_until(ours, b"Enter."))
        os.write(ours, b"\n")

    with terminal(monkeypatch) as ours:
        operator = TerminalOperator("VG-7")
        for act in (
            lambda: operator.power(False, lambda: time.sleep(0.01)),
            lambda: operator.mount("across", lambda: time.sleep(0.01)),
        ):
            typing = threading.Thread(target=answer, args=(ours,))
            typing.start()
            act()
            typing.join()
    os.close(ours)
    assert b"benchctl: the table is at rest: switch the supply of unit VG-7 off; then press Enter." in seen[0]
    assert b"the table is at rest: mount unit VG-7 with its input axis across the table's axis" in seen[1]


@needs_a_pty
def test_a_terminal_that_goes_away_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as ours:
        hanging_up = threading.Thread(target=lambda: (_read_until(ours, b"Enter."), os.close(ours)))
        hanging_up.start()
        with pytest.raises(SafetyError, match=r"switch the supply of unit VG-7 on; the terminal was closed before"):
            TerminalOperator("VG-7").power(True, lambda: time.sleep(0.01))
        hanging_up.join()


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a procedure, and a bench.toml that reaches a bench served by another process."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "by_hand.py").write_text(PROCEDURE)
    with simulated_servers(folder / "bench.toml", "--speed", "20"):
        yield folder


@pytest.mark.slow
def test_at_addresses_and_without_a_terminal_run_refuses_in_one_line(lab: Path) -> None:
    refused = subprocess.run(
        [sys.executable, "-m", "benchctl", "run", "by_hand.py", "--bench", "bench.toml", "--out", "refused"],
        cwd=lab,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=150,
    )
    assert refused.returncode == 2
    assert refused.stderr.startswith(
        "benchctl: procedure by_hand, step 1: power cycle: needs an operator, and there is"
    )
    assert len(refused.stderr.strip().splitlines()) == 1
    assert not (lab / "refused").exists()


@needs_a_pty
@pytest.mark.parametrize("answers", [4, 1], ids=["to its end", "Ctrl-C at the second question"])
@pytest.mark.slow
def test_at_addresses_the_operator_at_the_terminal_does_it(lab: Path, tmp_path: Path, answers: int) -> None:
    import pty

    ours, theirs = pty.openpty()
    arguments = ("run", lab / "by_hand.py", "--bench", lab / "bench.toml", "--out", tmp_path / "c")
    with subprocess.Popen(
        [sys.executable, "-m", "benchctl", *map(str, arguments)], stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        said = b""
        for _ in range(answers):
            said += _read_until(ours, b"press Enter.")
            os.write(ours, b"\n")
        if answers < 4:
            said += _read_until(ours, b"press Enter.")
            process.send_signal(signal.SIGINT)
        try:
            while True:
                said += os.read(ours, 4096)
        except OSError:  # the other end is closed: it has ended
            pass
        status = process.wait(timeout=20)
    os.close(ours)
    whose = {event["by"] for event in events(tmp_path / "c", "operator")}
    if answers == 4:
        assert status == 0, said.decode()
        assert done(tmp_path / "c") == ["supply off", "supply on", "mount across", "mount along"]
        with open_recording(tmp_path / "c") as recording:
            assert [info.whole for info in recording.infos] == [True] * 7
            assert recording.infos[0].t_end - recording.infos[0].t_start >= 40.0
    else:
        assert status == 3, said.decode()
        assert b"stopped by Ctrl-C" in said
        assert b"Fatal" not in said
        assert done(tmp_path / "c") == ["supply off"]
    assert len(whose) == 1
    assert whose.pop().endswith("at the terminal")
