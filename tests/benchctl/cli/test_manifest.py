"""A campaign's manifest, as the verbs write it and `verify` holds a campaign against it."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from benchctl.app.run import play
from benchctl.bench import Interlock
from benchctl.campaign.resume import past_of
from benchctl.cli.app import run_verb
from benchctl.cli.campaigns import at_terminal
from benchctl_instruments.errors import UsageError
from tests.benchctl.campaign.test_resume import BENCH, PLAN, begin, in_the_third_step

TURNS = """
from benchctl.plan import ConstantRate, Static, procedure

@procedure(calibrates=True)
def turns():
    '''Rates between zeros.'''
    yield Static(duration_s=30.0)
    for rate in (40.0, 80.0, -40.0, -80.0):
        yield ConstantRate(rate_dps=rate, duration_s=9.0)
"""
RESULTS = ["coefficients.json", "journal.jsonl", "recording.h5", "report.html"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("manifest")
    (folder / "turns.py").write_text(TURNS)
    run = ["run", str(folder / "turns.py"), "--bench", "simulated", "--out", str(folder / "c"), "--quiet"]
    assert run_verb(run) == 0
    return folder / "c"


@pytest.fixture
def campaign(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "c"))


def _verified(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any], str]:
    """Exit status, JSON, and stderr without the folder's name."""
    capsys.readouterr()
    status = run_verb(["verify", str(folder), "--json", "-"])
    said = capsys.readouterr()
    return status, json.loads(said.out), said.err.replace(f"benchctl: {folder}: ", "")


def _named(folder: Path) -> list[str]:
    return list(json.loads((folder / "manifest.json").read_text())["files"])


def test_run_writes_it_over_everything_that_it_leaves(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _named(campaign) == RESULTS
    status, told, _ = _verified(campaign, capsys)
    assert (status, told["problems"]) == (0, [])
    assert told["campaign_digest"] == json.loads((campaign / "manifest.json").read_text())["digest"]
    assert run_verb(["verify", str(campaign)]) == 0
    assert f"since it was written; campaign digest {told['campaign_digest']}" in capsys.readouterr().out


@pytest.mark.parametrize("name", RESULTS)
def test_verify_names_a_changed_file_and_fails(campaign: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    content = bytearray((campaign / name).read_bytes())
    content[len(content) // 2] ^= 4
    (campaign / name).write_bytes(content)
    status, told, err = _verified(campaign, capsys)
    assert status == 1
    assert told["ok"] is False
    assert f"{name}: changed since it was written" in err.splitlines()


def test_verify_names_what_was_deleted_and_what_was_added(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (campaign / "recording.h5").unlink()
    (campaign / "notes.txt").touch()
    status, told, err = _verified(campaign, capsys)
    assert status == 1
    assert err == "notes.txt: was added since the manifest was written\nrecording.h5: was deleted\n"
    assert told["error"] == "notes.txt: was added since the manifest was written"


@pytest.mark.parametrize(
    ("verb", "new"),
    [
        pytest.param(("fit", "CAMPAIGN"), [], marks=pytest.mark.slow),
        (("allan", "CAMPAIGN", "--scale-v-per-dps", "0.05"), ["allan.csv", "allan.html"]),
        pytest.param(("compare", "SIMULATED", "CAMPAIGN"), ["comparison.html"], marks=pytest.mark.slow),
    ],
)
def test_what_a_verb_adds_to_a_campaign_is_taken_into_its_manifest(
    made: Path, campaign: Path, verb: tuple[str, ...], new: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (campaign / "report.html").write_text("another")
    places = {"CAMPAIGN": str(campaign), "SIMULATED": str(campaign.parent / "simulated.h5")}
    if "SIMULATED" in verb:
        simulate = ["simulate", str(made.parent / "turns.py"), "--seed", "7", "-o", places["SIMULATED"]]
        assert run_verb([*simulate, "--quiet"]) == 0
    assert run_verb([*(places.get(part, part) for part in verb), "--quiet"]) == 0
    assert _named(campaign) == sorted([*RESULTS, *new])
    problems = _verified(campaign, capsys)[1]["problems"]
    assert [problem.partition(":")[0] for problem in problems] == ([] if verb[0] == "fit" else ["report.html"])


def test_a_campaign_whose_manifest_was_deleted_does_not_pass(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (campaign / "manifest.json").unlink()
    assert run_verb(["verify", str(campaign)]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"benchctl: {campaign}: manifest.json: is not there")
    assert run_verb(["verify", str(campaign / "recording.h5")]) == 0
    assert capsys.readouterr().out == f"{campaign / 'recording.h5'}: nothing changed since it was written\n"
    assert _verified(campaign, capsys)[1]["campaign_digest"] is None


def test_a_campaign_that_was_resumed_has_a_new_manifest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "c"
    begin(folder, in_the_third_step)
    assert not (folder / "manifest.json").exists()
    with past_of(folder, PLAN, BENCH) as past:
        outcome = play(PLAN, past.bench, folder, watch=at_terminal(quiet=True), wires=False, past=past)
    assert outcome.status == "complete"
    assert _named(folder) == ["journal.jsonl", "recording.h5"]
    assert _verified(folder, capsys)[0] == 0


def test_a_run_that_ends_early_has_one_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    over = Interlock(quantity="rate_dps", above=50.0)
    bench = BENCH.model_copy(update={"interlocks": (over,)})
    outcome = play(PLAN, bench, tmp_path / "c", watch=at_terminal(quiet=True), wires=False)
    assert outcome.status == "aborted"
    assert _verified(tmp_path / "c", capsys)[0] == 0


def test_a_manifest_that_cannot_be_written_is_said_and_hides_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(folder: Path) -> None:
        raise UsageError(f"{folder}: cannot be written: No space left on device")

    monkeypatch.setattr("benchctl.app.run.write_manifest", full)
    outcome = play(PLAN, BENCH, tmp_path / "c", watch=at_terminal(quiet=True), wires=False)
    assert outcome.status == "complete"
    assert capsys.readouterr().err.startswith("benchctl: warning: the campaign has no manifest: ")
