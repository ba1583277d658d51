"""A proof's trials: kept, gone on with, scored; with processes that answer at once in place of the real ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from benchctl.campaign.stop import StoppedError, StopRequest
from benchctl.proof.draw import draw
from benchctl.proof.processes import ProcessFailedError
from benchctl.proof.running import ProofSettings, run_proof
from benchctl.proof.trial import Trial
from benchctl_instruments.errors import InstrumentError, UsageError
from tests.benchctl.proof.made import finding, said

NOTHING = ProofSettings(seed=1, trials=3, only=("nothing",), generic=False, jobs=1)

Module = Callable[..., str]


class Bench:
    """Stands in for the processes: seals for real, records nothing, answers what it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, answer: dict[str, object]) -> None:
        self.answer, self.calls = answer, list[tuple[str, ...]]()
        self.digest: str | None = None
        self.fails: dict[str, str] = {}
        monkeypatch.setattr("benchctl.proof.running.run_module", self)

    def __call__(self, module: str, *arguments: str, stop: StopRequest, longest_s: float) -> str:
        stop.heed()
        self.calls.append((module, *arguments))
        if module in self.fails:
            raise ProcessFailedError(self.fails[module])
        if module == "benchctl.proof.seal":
            asked = dict(zip(arguments[::2], arguments[1::2], strict=True))
            truth = draw(int(asked["--seed"]), int(asked["--index"]), asked["--class"])  # type: ignore[arg-type]
            told = {"recording": asked["--out"], "rows": 7, "without": list(truth.withheld), "wall_s": 1.0}
            return json.dumps({"digest": self.digest or truth.digest()}) + "\n" + json.dumps(told) + "\n"
        out = Path(arguments[arguments.index("--out") + 1])
        generic = {"effects": ["warm_up"], "heldout_ratio": 1.5}
        found = generic if "generic" in arguments else self.answer
        out.write_text(json.dumps({"said": found, "seconds": 2.0, "peak_bytes": 5}))
        return ""


def run(settings: ProofSettings, folder: Path, stop: StopRequest | None = None) -> tuple[list[Trial], list[str]]:
    told: list[str] = []
    trials = list(
        run_proof(settings, folder, on_status=lambda i, what: told.append(f"{i} {what}"), stop=stop or StopRequest())
    )
    return trials, told


def test_every_trial_is_sealed_before_it_is_diagnosed_and_scored_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(monkeypatch, said(verdict="consistent"))
    trials, told = run(NOTHING, tmp_path)
    assert [trial.physics.right for trial in trials] == [True] * 3
    assert told[:2] == [f"0 sealed, sha256 {trials[0].digest}", "0 right"]
    assert [call[0].rpartition(".")[2] for call in bench.calls] == ["seal", "blind"] * 3
    assert sorted(path.name for path in (tmp_path / "trials").iterdir()) == ["0000.json", "0001.json", "0002.json"]


def test_the_process_that_answers_is_given_the_recording_and_what_is_withheld_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(monkeypatch, said(verdict="unknown-structure", where=("time",)))
    ((trial,), _) = run(ProofSettings(seed=9, trials=1, only=("outsider",), generic=True), tmp_path)
    seal, physics, generic = bench.calls
    recording = seal[seal.index("--out") + 1]
    without = ",".join(trial.truth["withheld"])
    assert physics[1:4] == (recording, "--arm", "physics")
    assert physics[-4:] == ("--without", without, "--part", "gyro")
    assert generic[1:4] == (recording, "--arm", "generic")
    assert trial.generic is not None
    assert trial.generic.stated == ("warm_up",)


def test_a_proof_goes_on_where_it_stopped_and_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, said(finding("warm_up")))
    first, _ = run(NOTHING, tmp_path)
    bench.calls.clear()
    again, told = run(ProofSettings(seed=1, trials=4, only=("nothing",), generic=False, jobs=1), tmp_path)
    assert [call[0] for call in bench.calls] == ["benchctl.proof.seal", "benchctl.proof.blind"]
    assert [trial.as_json() for trial in again[:3]] == [trial.as_json() for trial in first]
    assert told[-1] == "3 wrong"


def test_a_folder_of_another_proof_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Bench(monkeypatch, said(verdict="consistent"))
    run(NOTHING, tmp_path)
    with pytest.raises(UsageError, match=r"holds another proof, \{'seed': 1"):
        run(ProofSettings(seed=2, trials=3, only=("nothing",), generic=False), tmp_path)


def test_a_diagnosis_that_fails_counts_as_wrong_and_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, {})
    bench.fails = {"benchctl.proof.blind": "no answer after 900 s"}
    trials, told = run(NOTHING, tmp_path)
    assert [trial.physics.error for trial in trials] == ["no answer after 900 s"] * 3
    assert told[1] == "0 wrong"


def test_a_bench_that_fails_ends_the_proof_with_what_it_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, {})
    bench.fails = {"benchctl.proof.seal": "the table does not turn"}
    with pytest.raises(InstrumentError, match="trial 0: the simulated bench could not be recorded: the table does not"):
        run(NOTHING, tmp_path)
    assert list((tmp_path / "trials").iterdir()) == []


def test_what_is_unsealed_must_be_what_was_sealed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, said(verdict="consistent"))
    bench.digest = "0" * 64
    with pytest.raises(UsageError, match=r"trial 0: what was sealed as 0000.* is not what is unsealed"):
        run(NOTHING, tmp_path)


def test_a_wish_to_stop_leaves_whole_trials_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Bench(monkeypatch, said(verdict="consistent"))
    stop = StopRequest()
    stop.ask("Ctrl-C")
    with pytest.raises(StoppedError, match="stopped by Ctrl-C"):
        run(NOTHING, tmp_path, stop)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["proof.json", "trials"]


@pytest.mark.parametrize("keep", [False, True])
def test_recordings_are_kept_only_where_that_is_asked(
    keep: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Bench(monkeypatch, said(verdict="consistent"))
    run(ProofSettings(seed=1, trials=1, only=("nothing",), generic=False, keep=keep), tmp_path)
    assert (tmp_path / "recording-0000").exists() == keep
    assert not list(tmp_path.glob(".0*"))
