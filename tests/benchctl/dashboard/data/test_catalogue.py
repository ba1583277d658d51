"""The list of campaigns below a folder: what is in it, under which ids, and what is read again."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from benchctl.dashboard.data import catalogue as module
from benchctl.dashboard.data.catalogue import Catalogue
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.campaign_manifest import MANIFEST, write_manifest
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.benchctl.recordings.open_folder import write_open


@pytest.fixture(autouse=True)
def always_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_FRESH_S", 0.0)


def _recording(path: Path, started: str = "", steps: int = 2, **changes: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    provenance = {"procedure": "two_stage", "operator": "Ö. Ångström", "bench": "east", "started_utc": started}
    meta = made.meta(**({"provenance": provenance} | changes))
    write_recording(path, meta, made.steps(steps))
    return path


def _names(catalogue: Catalogue) -> list[str]:
    return [entry["name"] for entry in catalogue.list()]


def test_an_entry_says_what_a_page_lists(tmp_path: Path, cache: Path) -> None:
    _recording(tmp_path / "first" / "recording.h5", "2026-11-20T18:00:00+00:00")
    (entry,) = Catalogue(tmp_path, cache).list()
    assert len(entry.pop("id")) == 16
    assert entry == {
        "name": "first",
        "procedure": "two_stage",
        "unit": "VG-7",
        "model": "VG910Q",
        "status": "complete",
        "started_utc": "2026-11-20T18:00:00+00:00",
        "steps_planned": None,
        "steps_whole": 2,
        "samples": 400,
        "duration_s": 202.0,
        "operator": "Ö. Ångström",
        "bench": "east",
        "has": {"calibration": False, "diagnosis": False, "acceptance": False},
        "says": "",
        "integrity": "not verified",
        "altered": "",
    }


def test_a_file_that_does_not_agree_with_the_manifest_is_named(tmp_path: Path, cache: Path) -> None:
    path = _recording(tmp_path / "a" / "recording.h5")
    acceptance = path.with_name("acceptance.json")
    acceptance.write_text('{"schema": "benchctl-acceptance/1", "verdict": "FAIL"}')
    write_manifest(path.parent)
    catalogue = Catalogue(tmp_path, cache)
    assert catalogue.list()[0]["integrity"] == "verified"
    acceptance.write_text('{"schema": "benchctl-acceptance/1", "verdict": "PASS"}')
    os.utime(acceptance, ns=(1, 1))
    (entry,) = catalogue.list()
    assert (entry["integrity"], entry["has"]["acceptance"]) == ("altered", True)
    assert entry["altered"].startswith("acceptance.json: altered since the manifest")
    acceptance.unlink()
    _recording(path, steps=3)
    assert catalogue.list()[0]["altered"].startswith("recording.h5: altered")
    (path.parent / MANIFEST).write_text("{}")
    assert "manifest.json: expected schema" in catalogue.list()[0]["altered"]
    (path.parent / MANIFEST).unlink()
    assert catalogue.list()[0]["integrity"] == "not verified"


def test_campaigns_anywhere_below_are_listed_newest_first(tmp_path: Path, cache: Path) -> None:
    _recording(tmp_path / "old" / "recording.h5", "2026-01-01T00:00:00+00:00")
    _recording(tmp_path / "deep" / "er" / "new.h5", "2026-11-01T00:00:00+00:00")
    _recording(tmp_path / "old" / "recording_compensated.h5", "2026-05-01T00:00:00+00:00")
    _recording(tmp_path / ".hidden" / "recording.h5", "2026-06-01T00:00:00+00:00")
    write_open(tmp_path / "theirs")
    (tmp_path / "notes.txt").write_text("nothing")
    assert _names(Catalogue(tmp_path, cache)) == ["new", "recording_compensated", "old", "theirs"]


def test_the_folder_itself_may_be_a_campaign(tmp_path: Path, cache: Path) -> None:
    _recording(tmp_path / "recording.h5")
    catalogue = Catalogue(tmp_path, cache)
    (entry,) = catalogue.list()
    assert (entry["name"], catalogue.find(entry["id"])) == (tmp_path.name, tmp_path)


def test_a_campaign_runs_then_has_died_then_is_complete(tmp_path: Path, cache: Path) -> None:
    catalogue = Catalogue(tmp_path, cache)
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    writer.event("prepared", planned=7)
    step = writer.begin_step(made.info(1), (*made.STREAMED, *made.POLLED))
    step.append(made.step(1).channels)
    step.flush()
    (entry,) = catalogue.list()
    assert (entry["status"], entry["samples"], entry["steps_planned"], entry["steps_whole"]) == ("running", 200, 7, 0)
    step.append(made.streamed(102.0, 100))
    step.flush()
    assert catalogue.list()[0]["samples"] == 300
    writer.release()
    (entry,) = catalogue.list()
    assert entry["status"] == "died"
    assert entry["says"].startswith("its program died: benchctl recover ")
    assert not (tmp_path / "c" / "running.lock").exists()


def test_what_cannot_be_read_is_listed_and_says_why(tmp_path: Path, cache: Path) -> None:
    (tmp_path / "cut.h5").write_bytes(_recording(tmp_path / "x" / "recording.h5").read_bytes()[:-100])
    (tmp_path / "text.h5").write_text("no HDF5")
    found = {entry["name"]: entry for entry in Catalogue(tmp_path, cache).list()}
    assert found["cut"]["status"] == found["text"]["status"] == "unreadable"
    assert "was cut short" in found["cut"]["says"]
    assert "is not an HDF5 file" in found["text"]["says"]
    assert found["x"]["status"] == "complete"


def test_ids_lead_to_what_is_listed_and_to_nothing_else(tmp_path: Path, cache: Path) -> None:
    root = tmp_path / "root"
    path = _recording(root / "a" / "recording.h5").parent
    catalogue = Catalogue(root, cache)
    (entry,) = catalogue.list()
    assert catalogue.find(entry["id"]) == path
    assert catalogue.entry(entry["id"]) == entry
    for wrong in ("", "a", "../a", "a/recording.h5", "0" * 16, entry["id"].upper() + " "):
        assert catalogue.find(wrong) is None
    with pytest.raises(UsageError, match="there is no such campaign"):
        catalogue.entry("0" * 16)


def test_a_campaign_that_came_since_is_found_without_a_list(tmp_path: Path, cache: Path) -> None:
    key = Catalogue(tmp_path, cache)
    path = _recording(tmp_path / "b" / "recording.h5").parent
    other = Catalogue(tmp_path, cache).list()[0]["id"]
    assert key.find(other) == path


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege there")
def test_links_are_not_followed_wherever_they_lead(tmp_path: Path, cache: Path) -> None:
    root = tmp_path / "root"
    inside = _recording(root / "inside" / "recording.h5").parent
    outside = _recording(tmp_path / "outside" / "recording.h5").parent
    (root / "folder").symlink_to(outside)
    (root / "twice").symlink_to(inside)
    (root / "file.h5").symlink_to(outside / "recording.h5")
    (root / "half").mkdir()
    (root / "half" / "recording.h5").symlink_to(outside / "recording.h5")
    catalogue = Catalogue(root, cache)
    (entry,) = catalogue.list()
    assert entry["name"] == "inside"
    shutil.rmtree(inside)
    inside.symlink_to(outside)
    assert catalogue.find(entry["id"]) is None


def test_a_link_to_the_folder_itself_is_no_matter(tmp_path: Path, cache: Path) -> None:
    _recording(tmp_path / "real" / "a" / "recording.h5")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    catalogue = Catalogue(tmp_path / "link", cache)
    assert catalogue.find(catalogue.list()[0]["id"]) == tmp_path / "link" / "a"


def test_what_has_not_changed_is_not_read_again_not_even_by_another_program(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = _recording(tmp_path / "a" / "recording.h5")
    first = Catalogue(tmp_path, cache).list()
    read: list[Path] = []
    entry_of = module.entry_of
    monkeypatch.setattr(module, "entry_of", lambda one: (read.append(one), entry_of(one))[1])
    again = Catalogue(tmp_path, cache)
    assert again.list() == first
    assert read == []
    _recording(path, steps=3)
    assert again.list()[0]["steps_whole"] == 3
    assert read == [path.parent]
    (path.parent / "coefficients.json").write_text(json.dumps({"schema": "benchctl-coefficients/1", "source": []}))
    assert again.list()[0]["has"]["calibration"]


@pytest.mark.parametrize("damage", ["{", '{"format": 1}', '{"format": "x", "entries": 3}', "[]"])
def test_a_damaged_cache_is_made_anew(tmp_path: Path, cache: Path, damage: str) -> None:
    _recording(tmp_path / "a" / "recording.h5")
    first = Catalogue(tmp_path, cache).list()
    (kept,) = cache.glob("catalogue-*.json")
    kept.write_text(damage)
    assert Catalogue(tmp_path, cache).list() == first
    kept.write_text(json.dumps({"format": module._FORMAT, "entries": {"a": 1}}))
    assert Catalogue(tmp_path, cache).list() == first


def test_nothing_is_written_below_the_folder(tmp_path: Path, cache: Path) -> None:
    _recording(tmp_path / "a" / "recording.h5")
    write_open(tmp_path / "theirs")
    before = sorted((path, path.stat().st_mtime_ns) for path in tmp_path.rglob("*"))
    Catalogue(tmp_path, cache).list()
    assert sorted((path, path.stat().st_mtime_ns) for path in tmp_path.rglob("*")) == before


def test_of_many_that_were_never_read_some_are_counted_later(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "abc":
        _recording(tmp_path / name / "recording.h5", "2026-11-20T18:00:00+00:00")
    catalogue = Catalogue(tmp_path, cache)
    monkeypatch.setattr(module, "_PATIENCE_S", 0.0)
    first = catalogue.list()
    assert {(entry["unit"], entry["status"], entry["samples"]) for entry in first} == {("VG-7", "complete", 0)}
    assert {entry["says"] for entry in first} == {"its steps are not counted yet"}
    assert catalogue.entry(first[0]["id"])["samples"] == 400
    monkeypatch.setattr(module, "_PATIENCE_S", 3.0)
    assert {(entry["samples"], entry["says"]) for entry in catalogue.list()} == {(400, "")}


def test_a_list_is_given_again_for_a_moment(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_FRESH_S", 3600.0)
    catalogue = Catalogue(tmp_path, cache)
    assert catalogue.list() == []
    _recording(tmp_path / "a" / "recording.h5")
    assert catalogue.list() == []
    monkeypatch.setattr(module, "_FRESH_S", 0.0)
    assert _names(catalogue) == ["a"]
