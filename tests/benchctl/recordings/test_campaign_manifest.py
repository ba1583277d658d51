"""The manifest of a campaign's folder: what it names, and that no change of any file escapes it."""

import hashlib
import json
import multiprocessing
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from benchctl.recordings import digests
from benchctl.recordings.campaign_folder import CampaignWriter, campaign_lock
from benchctl.recordings.campaign_manifest import add_to_manifest, manifest_digest, write_manifest
from benchctl.recordings.recover import recover, reopen
from benchctl.recordings.verify import refuse_changed, verify
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made

FILES = ("coefficients.json", "journal.jsonl", "more/table.csv", "recording.h5", "report.html")


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished campaign with results, its manifest written."""
    folder = tmp_path_factory.mktemp("manifest") / "c"
    writer = CampaignWriter(folder, made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    step.append(made.streamed(0.0, 100))
    writer.step_over(step.close(made.info(1)))
    writer.finish("complete")
    (folder / "more").mkdir()
    (folder / "coefficients.json").write_text('{"K0_v_per_dps": 0.05}\n')
    (folder / "report.html").write_text("<!DOCTYPE html>\n")
    (folder / "more" / "table.csv").write_text("a,b\n1,2\n")
    write_manifest(folder)
    return folder


@pytest.fixture
def campaign(sealed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sealed, tmp_path / "c"))


def _found(folder: Path) -> list[str]:
    return [str(problem) for problem in verify(folder)]


def _flip(path: Path, byte: int, bit: int = 0) -> None:
    content = bytearray(path.read_bytes())
    content[byte] ^= 1 << bit
    path.write_bytes(content)


def test_it_names_every_file_with_its_digest_and_anyone_can_check_that_of_the_whole(campaign: Path) -> None:
    content = json.loads((campaign / "manifest.json").read_text())
    assert content["schema"] == "benchctl-campaign-manifest/1"
    assert tuple(content["files"]) == FILES
    for name, entry in content["files"].items():
        told = (campaign / name).read_bytes()
        assert (entry["sha256"], entry["bytes"]) == (hashlib.sha256(told).hexdigest(), len(told))
    with h5py.File(campaign / "recording.h5") as file:
        assert content["files"]["recording.h5"]["digest"] == file.attrs["digest"]
    text = json.dumps(content["files"], sort_keys=True, separators=(",", ":"))
    assert content["digest"] == hashlib.sha256(text.encode()).hexdigest() == manifest_digest(campaign)
    assert _found(campaign) == []


@pytest.mark.parametrize("name", FILES)
def test_a_single_bit_of_any_file_is_found(campaign: Path, name: str) -> None:
    _flip(campaign / name, (campaign / name).stat().st_size // 2)
    assert f"{name}: changed since it was written" in _found(campaign)


def test_the_first_bit_of_a_recording_is_found_though_it_is_no_recording_any_more(campaign: Path) -> None:
    _flip(campaign / "recording.h5", 0)
    first, second = _found(campaign)
    assert first.startswith(f"recording: {campaign}/recording.h5: ")
    assert second == "recording.h5: changed since it was written, and its own digest with it"


def test_a_recording_that_was_sealed_anew_is_found(campaign: Path) -> None:
    with h5py.File(campaign / "recording.h5", "r+") as file:
        file["steps/0001/gyro_v"][7] += 1e-9
        channels = dict(file["steps/0001"])
        sealed = {name: digests.digest_of(samples) for name, samples in channels.items()}
        digests.seal_step(file["steps/0001"], channels, sealed)
        digests.seal_recording(file)
    assert verify(campaign / "recording.h5") == []
    assert _found(campaign) == ["recording.h5: changed since it was written, and its own digest with it"]


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_was_deleted_is_found(campaign: Path, name: str) -> None:
    (campaign / name).unlink()
    assert _found(campaign) == [f"{name}: was deleted"]


def test_a_file_that_grew_was_added_or_is_no_file_any_more_is_found(campaign: Path) -> None:
    with (campaign / "journal.jsonl").open("a") as file:
        file.write("{}\n")
    size = (campaign / "journal.jsonl").stat().st_size
    (campaign / "report.html").unlink()
    (campaign / "report.html").mkdir()
    (campaign / "more" / "new\n.txt").touch()
    assert _found(campaign) == [
        f"journal.jsonl: changed since it was written: it has {size} bytes, had {size - 3}",
        "more/new?.txt: was added since the manifest was written",
        "report.html: was deleted",
    ]


def test_locks_and_hidden_files_are_nobodys_business(campaign: Path) -> None:
    for name in ("running.lock", "running.json", ".DS_Store", "more/.report.html.77.tmp"):
        (campaign / name).touch()
    write_manifest(campaign)
    for name in ("running.lock", "running.json", ".DS_Store", "more/.report.html.77.tmp"):
        (campaign / name).unlink()
    assert _found(campaign) == []


def test_a_single_bit_of_any_byte_of_the_manifest_itself_is_found(campaign: Path) -> None:
    manifest = campaign / "manifest.json"
    good = manifest.read_bytes()
    digest = manifest_digest(campaign)
    assert digest is not None
    for byte in range(len(good)):
        _flip(manifest, byte, byte % 8)
        assert manifest_digest(campaign) is None, byte
        manifest.write_bytes(good)
    assert manifest_digest(campaign) == digest


def _edited(**changes: object) -> Callable[[Path], None]:
    def edit(manifest: Path) -> None:
        content = json.loads(manifest.read_text())
        manifest.write_text(json.dumps(content | changes))

    return edit


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_edited(files={}), "manifest.json: its entries or its digest were changed; nothing can be held against it"),
        (_edited(note="all is well"), "manifest.json: its entries or its digest were changed"),
        (_edited(files=["a"]), "manifest.json: its files are no table of tables: it was changed; take"),
        (_edited(files={"a": 1}), "manifest.json: its files are no table of tables: it was changed; take"),
        (
            _edited(schema="benchctl-campaign-manifest/2"),
            "manifest.json: expected schema 'benchctl-campaign-manifest/1'",
        ),
        (lambda manifest: manifest.write_text("[" * 100_000), "manifest.json: cannot be used: manifest "),
        (lambda manifest: manifest.write_text("{"), "manifest.json: cannot be used: manifest "),
        (lambda manifest: manifest.write_text("[]"), "manifest.json: expected schema"),
    ],
)
def test_a_manifest_that_was_edited_is_one_problem_and_vouches_for_nothing(
    campaign: Path, spoil: Callable[[Path], None], says: str
) -> None:
    spoil(campaign / "manifest.json")
    (problem,) = _found(campaign)
    assert problem.startswith(says)
    assert "\n" not in problem


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(campaign: Path) -> None:
    (campaign / "report.html").unlink()
    os.mkfifo(campaign / "report.html")
    assert _found(campaign) == ["report.html: was deleted"]
    (campaign / "manifest.json").unlink()
    os.mkfifo(campaign / "manifest.json")
    (problem,) = _found(campaign)
    assert problem.startswith("manifest.json: cannot be used: ")


def test_results_are_taken_in_and_nothing_else_is_vouched_for_by_that(campaign: Path) -> None:
    before = manifest_digest(campaign)
    _flip(campaign / "journal.jsonl", 3)
    (campaign / "acceptance.html").write_text("PASS")
    (campaign / "report.html").write_text("another")
    (campaign / "stray.txt").touch()
    add_to_manifest(campaign, [campaign / "acceptance.html", campaign / "report.html", campaign / "not there"])
    assert _found(campaign) == [
        "journal.jsonl: changed since it was written",
        "stray.txt: was added since the manifest was written",
    ]
    assert manifest_digest(campaign) != before


def test_of_programs_that_add_results_at_once_no_entry_is_lost(campaign: Path) -> None:
    spawn = multiprocessing.get_context("spawn")
    adding = [spawn.Process(target=_add_many, args=(campaign, str(number))) for number in range(3)]
    for process in adding:
        process.start()
    for process in adding:
        process.join()
    assert [process.exitcode for process in adding] == [0, 0, 0]
    assert _found(campaign) == []
    assert len(list(campaign.glob("result *"))) == 3 * 20
    assert not list(campaign.glob(".*"))


def _add_many(campaign: Path, who: str) -> None:
    for number in range(20):
        result = campaign / f"result {who} {number}"
        result.touch()
        add_to_manifest(campaign, [result])


def test_nothing_becomes_good_by_taking_a_file_into_a_manifest_that_was_changed(campaign: Path) -> None:
    _edited(files={})(campaign / "manifest.json")
    before = (campaign / "manifest.json").read_bytes()
    add_to_manifest(campaign, [campaign / "report.html"])
    assert (campaign / "manifest.json").read_bytes() == before


def test_a_campaign_whose_manifest_was_deleted_does_not_pass_and_its_recording_by_itself_does(campaign: Path) -> None:
    (campaign / "manifest.json").unlink()
    add_to_manifest(campaign, [campaign / "report.html"])
    assert not (campaign / "manifest.json").exists()
    assert manifest_digest(campaign) is None
    (campaign / "report.html").write_text("another")
    assert _found(campaign) == [
        "manifest.json: is not there, the campaign's other files cannot be checked; verify recording.h5 by itself"
    ]
    assert _found(campaign / "recording.h5") == []
    _flip(campaign / "recording.h5", 0)
    with pytest.raises(UsageError, match=r"recording\.h5"):
        verify(campaign)


def test_a_changed_result_does_not_keep_a_recording_from_being_used(campaign: Path) -> None:
    (campaign / "report.html").write_text("another")
    refuse_changed(campaign, "fitted")


def test_a_campaign_that_goes_on_has_no_manifest_until_it_is_closed_again(campaign: Path) -> None:
    lock = campaign_lock(campaign)
    lock.acquire("test")
    writer, _ = reopen(campaign, 2, lock)
    assert not (campaign / "manifest.json").exists()
    writer.event("resume")
    writer.release()
    recover(campaign)
    assert _found(campaign) == []
    assert "coefficients.json" in json.loads((campaign / "manifest.json").read_text())["files"]


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="no file of which it is sure that it cannot be read")
def test_a_file_that_cannot_be_read_is_told(campaign: Path) -> None:
    (campaign / "report.html").unlink()
    (campaign / "report.html").symlink_to("/proc/self/mem")
    assert _found(campaign) == ["report.html: cannot be read: input/output error"]
