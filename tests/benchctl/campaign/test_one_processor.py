"""Simulated benches on a processor each, as long as there are any."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from benchctl import processors
from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from benchctl.processors import on_one_processor, several

pytestmark = pytest.mark.skipif(len(several()) < 2, reason="needs Linux and two processors")

HOLDS = """
import os, sys
from benchctl import processors
processors._NAME = "\\0" + sys.argv[1]
with processors.on_one_processor():
    print(sorted(os.sched_getaffinity(0)), flush=True)
    sys.stdin.readline()
"""


@pytest.fixture(autouse=True)
def name(monkeypatch: pytest.MonkeyPatch) -> str:
    """Processors are taken by a name of the test's own: benches of other tests may be played meanwhile."""
    name = f"\0benchctl-test-{os.getpid()}-"
    monkeypatch.setattr(processors, "_NAME", name)
    return name


def test_a_simulated_bench_is_played_on_one_processor_and_leaves_all_of_them_behind() -> None:
    before = os.sched_getaffinity(0)
    with open_bench(load_bench("simulated")):
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def test_without_wires_there_is_nobody_to_take_turns_with() -> None:
    before = os.sched_getaffinity(0)
    with open_bench(load_bench("simulated"), wires=False):
        assert os.sched_getaffinity(0) == before


def test_processes_side_by_side_take_processors_of_their_own_until_none_is_left(name: str) -> None:
    numbers, pipe = several(), subprocess.PIPE
    holds = [sys.executable, "-c", HOLDS, name[1:]]
    held = [subprocess.Popen(holds, stdin=pipe, stdout=pipe, text=True) for _ in numbers]
    try:
        taken = [process.stdout.readline().strip() for process in held if process.stdout is not None]
        assert sorted(taken) == sorted(f"[{number}]" for number in numbers)
        with on_one_processor():
            assert sorted(os.sched_getaffinity(0)) == numbers
    finally:
        for process in held:
            process.communicate("\n")
    with on_one_processor():
        assert len(os.sched_getaffinity(0)) == 1
