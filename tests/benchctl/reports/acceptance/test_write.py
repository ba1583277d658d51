"""The report's files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording
from benchctl.reports.acceptance.set_up import facts_of
from benchctl.reports.acceptance.write import write_acceptance
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.benchctl.reports.acceptance.example import acceptance, facts


@pytest.mark.slow
def test_the_four_files_are_written_in_the_language(tmp_path: Path) -> None:
    paths = write_acceptance(acceptance(), facts(), tmp_path / "new", "ru")
    names = ["acceptance.html", "acceptance.pdf", "acceptance.xml", "acceptance.json"]
    assert [path.name for path in paths.values()] == names
    assert list(paths) == ["report", "pdf", "junit", "json"]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(names)
    assert paths["pdf"].read_bytes().startswith(b"%PDF-")
    assert "Протокол" in paths["report"].read_text(encoding="utf-8")
    told = json.loads(paths["json"].read_text(encoding="utf-8"))
    assert told["schema"] == "benchctl-acceptance/1"
    assert told["verdict"] == "FAIL"


@pytest.mark.slow
def test_the_same_results_give_the_same_files(tmp_path: Path) -> None:
    first, second = (write_acceptance(acceptance(), facts(), tmp_path / name) for name in ("a", "b"))
    assert [path.read_bytes() for path in first.values()] == [path.read_bytes() for path in second.values()]


@pytest.mark.parametrize(("language", "says"), [("de", "--lang de: the report is written in en or ru")])
def test_nothing_is_written_in_an_unknown_language(tmp_path: Path, language: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        write_acceptance(acceptance(), facts(), tmp_path / "new", language)
    assert not (tmp_path / "new").exists()


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "new").write_text("")
    with pytest.raises(UsageError, match="cannot be made"):
        write_acceptance(acceptance(judged=()), facts(), tmp_path / "new")


def test_facts_come_from_an_open_recording(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path)) as recording:
        found = facts_of(recording)
        assert found.digest == recording.digest != ""
    assert found.name == "made.h5"
    assert [info.index for info in found.infos] == [1, 2, 3]
    assert found.started.year == 2000
    paths = write_acceptance(acceptance(judged=()), found, tmp_path / "report")
    assert found.digest in paths["report"].read_text(encoding="utf-8")
