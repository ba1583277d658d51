"""`benchctl export` of what was fitted: the coefficients that belong to what was named, in a new file."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from benchctl.recordings.reader import open_recording
from tests.benchctl.calibration.made_coefficients import written
from tests.benchctl.recordings import made

Verb = Callable[..., tuple[int, str]]


@pytest.fixture
def export(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Verb:
    """Run the verb in an empty folder; returns its status and its one line."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str | Path) -> tuple[int, str]:
        status = run_verb(["export", *map(str, arguments)])
        captured = capsys.readouterr()
        lines = (captured.out + captured.err).splitlines()
        assert len(lines) == 1
        return status, lines[0]

    return run


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A recording with coefficients beside it that were fitted on it."""
    path = made.recording(tmp_path)
    with open_recording(path) as opened:
        written(tmp_path, source=[{"recording": path.name, "digest": opened.digest}])
    return path


@pytest.mark.parametrize(("to", "name"), [("c-header", "made_compensation.h"), ("json", "made_compensation.json")])
def test_the_coefficients_beside_a_recording_are_exported(export: Verb, recording: Path, to: str, name: str) -> None:
    assert export(recording.name, "--to", to) == (0, f"wrote {name}")
    assert "VG-7" in (recording.parent / name).read_text()


def test_coefficients_and_folders_are_named_themselves(export: Verb, recording: Path) -> None:
    folder = recording.parent / "campaign"
    folder.mkdir()
    recording.rename(folder / "recording.h5")
    (recording.parent / "coefficients.json").rename(folder / "coefficients.json")
    assert export("campaign", "--to", "c-header", "-o", "one.h")[0] == 0
    assert export("campaign/coefficients.json", "--to", "c-header", "-o", "two.h")[0] == 0
    (folder / "recording.h5").unlink()
    assert export("campaign", "--to", "c-header", "-o", "three.h")[0] == 0
    headers = [(recording.parent / f"{name}.h").read_bytes() for name in ("one", "two", "three")]
    assert headers[0] == headers[1] == headers[2]


def test_the_result_is_told_to_programs(export: Verb, recording: Path) -> None:
    assert export(recording, "--to", "json", "-o", "c.json", "--json", "out.json")[0] == 0
    assert json.loads((recording.parent / "out.json").read_text())["output"] == "c.json"


def test_what_is_there_already_is_left(export: Verb, recording: Path) -> None:
    before = (recording.parent / "coefficients.json").read_bytes()
    status, line = export(recording, "--to", "json", "-o", "coefficients.json")
    assert status == 2
    assert "is there already" in line
    assert (recording.parent / "coefficients.json").read_bytes() == before
    for to in ("c-header", "json", "mat", "netcdf"):
        assert "is a folder" in export(recording, "--to", to, "-o", ".")[1]


def test_a_recording_that_was_not_fitted_says_how(export: Verb, recording: Path) -> None:
    (recording.parent / "coefficients.json").unlink()
    status, line = export(recording, "--to", "c-header")
    assert status == 2
    assert "there is no coefficients.json in" in line
    assert f"benchctl fit {recording}" in line


def test_coefficients_of_another_recording_in_the_folder_are_not_taken(export: Verb, recording: Path) -> None:
    written(recording.parent)
    status, line = export(recording, "--to", "c-header", "-o", "g.h")
    assert status == 2
    assert "was not fitted on" in line
    assert not (recording.parent / "g.h").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [("{", "not JSON"), ('{"schema": "other/1"}', "expected schema 'benchctl-coefficients/1', found 'other/1'")],
)
def test_coefficients_that_are_none_are_refused(export: Verb, recording: Path, text: str, says: str) -> None:
    (recording.parent / "coefficients.json").write_text(text)
    for source in (recording, "coefficients.json"):
        status, line = export(source, "--to", "c-header", "-o", "g.h")
        assert status == 2
        assert says in line
    assert not (recording.parent / "g.h").exists()


def test_what_is_not_there_is_named(export: Verb, tmp_path: Path) -> None:
    for source in ("none.h5", "none.json", "."):
        status, line = export(source, "--to", "c-header", "-o", "g.h")
        assert status == 2
        assert source in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", [".", ".."])
def test_a_folder_that_somebody_is_in_is_not_replaced(
    export: Verb, recording: Path, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    (empty := recording.parent / "empty" / "below").mkdir(parents=True)
    monkeypatch.chdir(empty)
    status, line = export(recording, "--to", "csv", "-o", folder)
    assert status == 2
    assert "name a new one in it" in line
    assert list(empty.iterdir()) == []


def test_an_export_of_the_current_folder_lies_beside_it(export: Verb, recording: Path) -> None:
    recording.rename(recording.parent / "recording.h5")
    target = recording.parent.with_name(recording.parent.name + "_compensation.h")
    assert export(".", "--to", "c-header") == (0, f"wrote {target}")
    target.unlink()


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
@pytest.mark.parametrize("quiet", [False, True])
def test_a_terminal_shows_what_is_done_while_it_lasts(recording: Path, quiet: bool) -> None:
    import pty

    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "benchctl", "export", recording.name, "--to", "csv", *["--quiet"] * quiet]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs, cwd=recording.parent) as process:
        os.close(theirs)
        shown = b""
        try:
            while chunk := os.read(ours, 4096):
                shown += chunk
        except OSError:  # Linux states the end of a terminal so
            pass
        os.close(ours)
    assert process.returncode == 0
    assert (f"exporting {recording.name}".encode() in shown) is not quiet
