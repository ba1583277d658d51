"""The runner itself: it counts, it tells a death in C from a fault of ours, and it says what it lacks."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.fuzz import run
from tests.fuzz.harness import Harness, clear_workplace, harness_names
from tests.fuzz.isolated import changes, run_isolated

ROOT = Path(__file__).resolve().parents[2]


def _moody(data: bytes) -> None:
    if data == b"die":
        os.kill(os.getpid(), signal.SIGSEGV)
    if data == b"raise":
        raise ValueError("of ours")


def test_what_dies_and_what_raises_is_counted_and_the_rest_goes_on() -> None:
    inputs = [b"a", b"die", b"b", b"raise", b"die", b"c"]
    moody = Harness(name="moody", one_input=_moody, seeds=list, native=True)
    found = run_isolated(moody, inputs.__getitem__, len(inputs))
    clear_workplace()
    assert found.inputs == 6
    assert found.deaths == [(b"die", "SIGSEGV")] * 2
    [(data, said)] = found.faults
    assert data == b"raise"
    assert said.strip().endswith("ValueError: of ours")


def test_the_same_seed_gives_the_same_inputs() -> None:
    one = Harness(name="none", one_input=_moody, seeds=lambda: [b"abc" * 20])
    first, again, other = (changes(one, seed) for seed in (1, 1, 2))
    assert [first(k) for k in range(20)] == [again(k) for k in range(20)]
    assert [first(k) for k in range(20)] != [other(k) for k in range(20)]


def test_without_atheris_it_says_what_to_install() -> None:
    script = "import sys; sys.modules['atheris'] = None; from tests.fuzz import run; sys.exit(run.main())"
    done = subprocess.run(
        [sys.executable, "-c", script, "--inputs", "10"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "pip install -e '.[fuzz]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_worker_that_was_full_is_followed_by_others_until_all_inputs_are_had(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def takes_400_at_most(
        outcome: run.Outcome, inputs: int, seconds: int, scratch: Path
    ) -> tuple[dict[str, Any], bool]:
        asked.append((inputs, seconds, scratch))
        outcome.inputs += min(inputs, 400)
        return {"full": inputs > 400}, False

    monkeypatch.setattr(run, "_process", takes_400_at_most)
    outcome = run.Outcome("frames", inputs=50)
    assert not run._run(outcome, 1000, 0, tmp_path)
    assert asked == [(1000, 0, tmp_path), (600, 0, tmp_path), (200, 0, tmp_path)]
    assert outcome.inputs == 1050


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_with_atheris_every_harness_runs_and_stands_in_the_table(tmp_path: Path) -> None:
    pytest.importorskip("atheris")
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.run", "--inputs", "1500", "--seconds", "10", "--keep", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    named = [line.split(" | ")[0].removeprefix("| ") for line in done.stdout.splitlines() if line.startswith("| ")]
    assert named == ["parsers", *harness_names(), "all"]


@pytest.mark.slow
def test_a_worker_that_has_grown_too_large_says_so_and_ends_without_a_crash(tmp_path: Path) -> None:
    pytest.importorskip("atheris")
    script = (
        "from tests.fuzz import worker\n"
        "worker._MOST_RESIDENT_BYTES = 0\n"
        f"sys.argv = ['worker', 'addresses', '5000', '0', {str(tmp_path)!r}]\n"
        "worker.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", f"import sys\n{script}"], cwd=ROOT, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["full"]
    assert 0 < told["inputs"] < 5000
