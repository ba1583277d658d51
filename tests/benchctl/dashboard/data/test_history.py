"""The history of units as `benchctl history --json` has it, with its index in the cache."""

import json
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from benchctl.dashboard.data.contents import cache_folder
from benchctl.dashboard.data.history import history_json
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


def test_it_says_what_the_verb_says_and_writes_nothing_below_the_folder(tmp_path: Path, cache: Path) -> None:
    root = tmp_path / "root"
    for day in (1, 2, 3):
        folder = root / f"campaign{day}"
        folder.mkdir(parents=True)
        meta = made.meta(provenance={"procedure": "static", "started_utc": f"2026-11-0{day}T10:00:00+00:00"})
        write_recording(folder / "recording.h5", meta, made.steps(1))
    before = sorted(root.rglob("*"))
    found = history_json(root, cache)
    assert sorted(root.rglob("*")) == before
    assert len(list(cache.glob("history-*.sqlite"))) == 1
    assert history_json(root, cache) == found
    assert found["index"] is None
    assert run_verb(["history", str(root), "--json", str(tmp_path / "told.json"), "--quiet"]) == 0
    told = json.loads((tmp_path / "told.json").read_text())
    assert (found["units"], found["problems"]) == (told["units"], told["problems"])
    assert [campaign["path"] for campaign in found["units"][0]["campaigns"]] == [
        f"campaign{day}/recording.h5" for day in (1, 2, 3)
    ]


def test_a_folder_without_campaigns_is_said_to_be_one_without_naming_its_place(tmp_path: Path, cache: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=r"^empty: holds no campaign"):
        history_json(tmp_path / "empty", cache)


def test_the_cache_is_where_the_environment_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("BENCHCTL_CACHE", str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine"
    monkeypatch.delenv("BENCHCTL_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "benchctl"
    monkeypatch.setattr("sys.platform", "darwin")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "Library" / "Caches" / "benchctl"
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    assert cache_folder() == tmp_path / "local" / "benchctl" / "cache"
