"""Copies of a campaign, one of which was altered: the intact one is charted, the other named."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import pytest

from benchctl.history.history import History
from benchctl.recordings.campaign_manifest import MANIFEST, write_manifest
from tests.benchctl.history.made_history import accepted, one_test, only, read, recorded, started

GENUINE, FORGED = "b_genuine", "a_forged"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two accepted campaigns of one unit, as they were finished; and a copy of the second, before it by name."""
    for number, name in enumerate(("c_before", GENUINE)):
        digest = recorded(tmp_path / name / "recording.h5", started_utc=started(number), rows=2000)
        (tmp_path / name / "acceptance.json").write_text(accepted([one_test(value=1.0)], digest))
        write_manifest(tmp_path / name)
    shutil.copytree(tmp_path / GENUINE, tmp_path / FORGED)
    return tmp_path


def forge_document(place: Path) -> None:
    document = json.loads((place / "acceptance.json").read_text())
    document["tests"][0]["value"] = 0.001
    (place / "acceptance.json").write_text(json.dumps(document))


def damage_recording(place: Path) -> None:
    """Change a sample; size, description and the digest of the root stay as they are."""
    with h5py.File(place / "recording.h5", "r+") as file:
        file["steps/0001/gyro_v"][5] += 1.0


def charted(history: History) -> list[float]:
    (one,) = only(history).figures
    return [point.value for point in one.series.points]


def counted(history: History) -> list[str]:
    return [one.path.split("/")[0] for one in only(history).campaigns]


def problems(history: History) -> dict[str, str]:
    return {problem.where: problem.message for problem in history.problems}


def test_a_forged_document_is_named_and_the_genuine_one_charted(folder: Path) -> None:
    forge_document(folder / FORGED)
    damage_recording(folder / FORGED)
    history = read(folder)
    assert charted(history) == [1.0, 1.0]
    assert "was altered" in problems(history)[f"{FORGED}/acceptance.json"]
    assert {point.integrity for one in only(history).figures for point in one.series.points} == {"verified"}


def test_a_copy_whose_manifest_was_deleted_does_not_count_beside_one_that_agrees_with_its_manifest(
    folder: Path,
) -> None:
    forge_document(folder / FORGED)
    (folder / FORGED / MANIFEST).unlink()
    history = read(folder)
    assert charted(history) == [1.0, 1.0]
    assert counted(history) == ["c_before", GENUINE]
    assert "not verified" in problems(history)[f"{FORGED}/recording.h5"]


@pytest.mark.parametrize("with_manifests", [True, False])
def test_of_copies_that_state_different_figures_all_samples_are_checked(folder: Path, with_manifests: bool) -> None:
    forge_document(folder / FORGED)
    damage_recording(folder / FORGED)
    if with_manifests:
        write_manifest(folder / FORGED)  # whoever forges may write the manifest anew, too
    else:
        for place in (FORGED, GENUINE):
            (folder / place / MANIFEST).unlink()
    history = read(folder)
    assert charted(history) == [1.0, 1.0]
    assert counted(history) == ["c_before", GENUINE]
    says = problems(history)[f"{FORGED}/recording.h5"]
    assert "changed since it was written, and so not counted" in says
    assert "gyro_v" in says


def test_the_samples_of_competing_copies_are_checked_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forge_document(folder / FORGED)
    write_manifest(folder / FORGED)
    first = read(folder)
    monkeypatch.setattr("benchctl.history.history.refuse_changed", lambda *_: pytest.fail("was checked again"))
    assert read(folder) == first


def test_copies_that_state_the_same_are_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchctl.history.history.refuse_changed", lambda *_: pytest.fail("was read"))
    history = read(folder)
    assert charted(history) == [1.0, 1.0]
    assert problems(history)[f"{GENUINE}/recording.h5"].startswith("is the same recording as a_forged")


def test_of_intact_copies_that_state_different_figures_the_other_is_named(folder: Path) -> None:
    forge_document(folder / FORGED)
    write_manifest(folder / FORGED)
    history = read(folder)
    assert "nothing here shows which are right" in problems(history)[f"{GENUINE}/recording.h5"]


def test_an_altered_campaign_without_a_copy_does_not_count(folder: Path) -> None:
    shutil.rmtree(folder / FORGED)
    forge_document(folder / GENUINE)
    assert charted(read(folder)) == [1.0]
    recorded(folder / GENUINE / "recording.h5", started_utc=started(1), rows=1999)
    history = read(folder)
    assert counted(history) == ["c_before"]
    assert "was altered" in problems(history)[f"{GENUINE}/recording.h5"]


def test_a_manifest_that_was_changed_is_named_and_verifies_nothing(folder: Path) -> None:
    manifest = folder / FORGED / MANIFEST
    manifest.write_text(manifest.read_text().replace('"bytes"', '"Bytes"', 1))
    history = read(folder)
    assert "were changed" in problems(history)[f"{FORGED}/{MANIFEST}"]
    assert counted(history) == ["c_before", GENUINE]


def test_what_has_no_manifest_counts_and_is_not_verified(folder: Path) -> None:
    (folder / "c_before" / MANIFEST).unlink()
    campaigns = only(read(folder)).campaigns
    assert [one.integrity for one in campaigns] == ["not verified", "verified"]
