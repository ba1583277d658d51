"""The guard listens, on a real pipe."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator

import pytest

from benchctl.campaign.guard import orders as module
from benchctl.campaign.guard.orders import Ending, PipeLines, watch


class Runner:
    """The runner's end of the pipe, and what it was answered."""

    def __init__(self) -> None:
        out, self._into = os.pipe()
        self.lines = PipeLines(os.fdopen(out, "rb", buffering=0))
        self.answers = 0

    def says(self, *words: str) -> None:
        os.write(self._into, "".join(f"{word}\n" for word in words).encode())

    def ends(self) -> None:
        if self._into >= 0:
            os.close(self._into)
        self._into = -1

    def watched(self) -> Ending:
        return watch(self.lines, self._answer)

    def _answer(self) -> None:
        self.answers += 1


@pytest.fixture
def runner() -> Iterator[Runner]:
    runner = Runner()
    yield runner
    runner.ends()


def test_a_runner_that_says_done_is_done(runner: Runner) -> None:
    runner.says("beat 60.000", "beat 60.000", "done")
    assert runner.watched() is Ending.DONE
    assert runner.answers == 2


def test_a_runner_that_ends_before_its_first_beat_has_moved_nothing(runner: Runner) -> None:
    runner.ends()
    assert runner.watched() is Ending.UNARMED


def test_a_runner_that_ends_without_done_is_noticed_at_once(runner: Runner) -> None:
    runner.says("beat 60.000")
    runner.ends()
    began_s = time.monotonic()
    assert runner.watched() is Ending.ENDED
    assert time.monotonic() - began_s < 1.0


def test_a_silence_longer_than_was_announced_is_a_hang_and_a_shorter_one_is_not(runner: Runner) -> None:
    runner.says("beat 0.100", "beat 0.600")
    began_s = time.monotonic()
    assert runner.watched() is Ending.HANGS
    assert time.monotonic() - began_s >= 0.6


def test_time_in_which_the_whole_machine_stood_still_is_no_silence_of_the_runner(
    runner: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    asleep_s = 0.0
    monotonic = time.monotonic
    monkeypatch.setattr(module.time, "monotonic", lambda: monotonic() + asleep_s)

    def wake(timeout_s: float | None) -> str | None:
        nonlocal asleep_s
        if not asleep_s:
            asleep_s = 3600.0
            return None
        return heard(timeout_s)

    heard = runner.lines.next
    runner.says("beat 5.000")
    assert heard(1.0) == "beat 5.000\n"
    runner.says("done")
    words = iter(["beat 5.000\n"])
    monkeypatch.setattr(runner.lines, "next", lambda timeout_s: next(words, None) or wake(timeout_s))
    assert runner.watched() is Ending.DONE


def test_the_end_of_the_pipe_is_waited_for_and_words_before_it_are_passed_over(runner: Runner) -> None:
    runner.says("beat 60.000")
    assert not runner.lines.end(0.05)
    runner.says("beat 60.000")
    runner.ends()
    assert runner.lines.end(5.0)
