"""The index: a cache of the files, never more."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from benchctl.history.history import history_of
from benchctl.history.index import NAME, place_of
from benchctl_instruments.errors import UsageError
from tests.benchctl.history.made_history import (
    accepted,
    campaign,
    digest_in,
    figure,
    fitted,
    one_test,
    only,
    read,
    recorded,
    started,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(3):
        campaign(tmp_path / "all", number=number, K0=0.05 + number)
    return tmp_path / "all"


def test_a_deleted_index_is_made_again_and_says_the_same(folder: Path) -> None:
    first = read(folder)
    assert first.index == folder / NAME
    (folder / NAME).unlink()
    assert read(folder) == first
    assert (folder / NAME).exists()


@pytest.mark.parametrize("damage", ["text", "cut", "flipped", "foreign"])
def test_a_damaged_index_is_thrown_away_in_one_line(folder: Path, damage: str) -> None:
    first = read(folder)
    index = folder / NAME
    if damage == "text":
        index.write_text("no database at all, " * 1000)
    elif damage == "cut":
        index.write_bytes(index.read_bytes()[:5000])
    elif damage == "flipped":
        content = bytearray(index.read_bytes())
        content[4096:12288] = bytes(range(256)) * 32
        index.write_bytes(content)
    else:
        with closing(sqlite3.connect(index)) as database, database:
            database.execute("DROP TABLE figures")
    said: list[str] = []
    assert history_of(folder, "all", said.append) == first
    (line,) = said
    assert line.startswith(f"{index}: ")
    assert line.endswith("the index is thrown away and made anew from the recordings")
    assert read(folder) == first


def test_an_index_of_another_version_is_made_anew_without_a_word(folder: Path) -> None:
    first = read(folder)
    with closing(sqlite3.connect(folder / NAME)) as database, database:
        database.execute("PRAGMA user_version = 999")
        database.execute("DROP TABLE campaigns")
    assert read(folder) == first


def test_only_what_changed_is_read_again(folder: Path) -> None:
    read(folder)
    with closing(sqlite3.connect(folder / NAME)) as database, database:
        database.execute("UPDATE figures SET value = -1.0")
    values = [point.value for point in figure(read(folder)).series.points]
    assert values == [-1.0, -1.0, -1.0]  # the files were not opened: size and time are as they were
    changed = folder / "001_SN-1" / "coefficients.json"
    changed.write_text(fitted({"K0_v_per_dps": (0.07, 1e-5)}, digest_in(changed.parent)))
    values = [point.value for point in figure(read(folder)).series.points]
    assert values == [-1.0, 0.07, -1.0]


def test_a_file_of_the_same_size_and_another_time_is_read_again(folder: Path) -> None:
    read(folder)
    changed = folder / "001_SN-1" / "coefficients.json"
    text = changed.read_text()
    changed.write_text(text.replace("1.05", "1.06"))
    assert changed.stat().st_size == len(text.encode())
    os.utime(changed, ns=(1, 1))
    assert [point.value for point in figure(read(folder)).series.points] == [0.05, 1.06, 2.05]


def test_a_deleted_campaign_disappears_and_a_new_one_appears(folder: Path) -> None:
    read(folder)
    shutil.rmtree(folder / "001_SN-1")
    assert [one.path for one in only(read(folder)).campaigns] == ["000_SN-1/recording.h5", "002_SN-1/recording.h5"]
    campaign(folder, number=5)
    assert len(figure(read(folder)).series.points) == 3


def test_a_moved_folder_keeps_its_index(folder: Path) -> None:
    first = read(folder)
    moved = folder.rename(folder.parent / "moved")
    assert read(moved).units == first.units


def test_what_cannot_be_read_is_a_problem_and_tried_again(folder: Path) -> None:
    (folder / "bad.h5").write_bytes(b"no hdf5")
    (folder / "000_SN-1" / "acceptance.json").write_text('{"schema": "other"}')
    (folder / "001_SN-1" / "acceptance.json").write_text(accepted([one_test(value="1")], "x"))  # type: ignore[arg-type]
    recorded(folder / "undated.h5", started_utc="")
    recorded(folder / "misdated.h5", started_utc="yesterday")
    history = read(folder)
    assert [problem.where for problem in history.problems] == [
        "000_SN-1/acceptance.json",
        "001_SN-1/acceptance.json",
        "bad.h5",
        "misdated.h5",
        "undated.h5",
    ]
    says = [problem.message for problem in history.problems]
    assert says[0] == ("expected schema 'benchctl-acceptance/1', found 'other'; write it with `benchctl accept`")
    assert says[1] == "value is '1', expected a number"
    assert says[2].startswith("is not an HDF5 file")
    assert "expected ISO 8601" in says[3]
    assert "does not say when it was made" in says[4]
    assert len(only(history).campaigns) == 3
    (folder / "bad.h5").unlink()
    assert "bad.h5" not in [problem.where for problem in read(folder).problems]


def test_a_campaign_that_is_not_finished_is_told_of(folder: Path) -> None:
    recorded(folder / "running" / "campaign.h5")
    recorded(folder / "running" / "steps" / "0001_rest.h5")
    (problem,) = read(folder).problems
    assert problem.where == "running"
    assert "benchctl recover" in problem.message


def test_a_document_belongs_to_the_recording_whose_digest_it_names(folder: Path) -> None:
    place = folder / "001_SN-1"
    (folder / "elsewhere").mkdir()
    (place / "coefficients.json").rename(folder / "elsewhere" / "coefficients.json")
    assert [point.value for point in figure(read(folder)).series.points] == [0.05, 1.05, 2.05]
    recorded(place / "recording.h5", started_utc=started(9))  # another recording now
    history = read(folder)
    assert [point.value for point in figure(history).series.points] == [0.05, 2.05]
    assert history.problems[0].where == "elsewhere/coefficients.json"


def test_a_copy_of_a_recording_counts_once_and_a_second_document_not_at_all(folder: Path) -> None:
    shutil.copytree(folder / "001_SN-1", folder / "zzz_copy")
    history = read(folder)
    assert [point.value for point in figure(history).series.points] == [0.05, 1.05, 2.05]
    assert [problem.where for problem in history.problems] == ["zzz_copy/coefficients.json", "zzz_copy/recording.h5"]


def test_coefficients_of_two_recordings_count_for_the_first(folder: Path) -> None:
    digests = [digest_in(folder / name) for name in ("000_SN-1", "001_SN-1")]
    for name in ("000_SN-1", "001_SN-1"):
        (folder / name / "coefficients.json").unlink()
    (folder / "000_SN-1" / "coefficients.json").write_text(fitted({"K0_v_per_dps": (7.0, None)}, *digests))
    points = figure(read(folder)).series.points
    assert [(point.campaign[:3], point.value) for point in points] == [("000", 7.0), ("002", 2.05)]


def test_a_document_without_a_digest_belongs_to_the_one_recording_beside_it(folder: Path) -> None:
    (folder / "001_SN-1" / "acceptance.json").write_text(accepted([one_test()], ""))
    assert figure(read(folder), "bias").series.latest.campaign == "001_SN-1/recording.h5"
    recorded(folder / "001_SN-1" / "other.h5", serial="SN-2")
    assert [problem.where for problem in read(folder).problems] == ["001_SN-1/acceptance.json"]


def test_tests_at_several_temperatures_are_figures_of_their_own(folder: Path) -> None:
    tests = [
        one_test(value=value, temperature_c=celsius) for value, celsius in ((1.0, -39.8), (2.0, 20.1), (3.0, 59.9))
    ]
    place = folder / "001_SN-1"
    (place / "acceptance.json").write_text(accepted([*tests, one_test("noise")], digest_in(place)))
    names = [one.series.name for one in only(read(folder)).figures]
    assert names == ["bias at -40 °C", "bias at 20 °C", "bias at 60 °C", "noise", "K0_v_per_dps"]


@pytest.mark.slow
def test_two_processes_at_once_leave_a_whole_index_and_say_the_same(folder: Path) -> None:
    for number in range(3, 30):
        campaign(folder, number=number, K0=0.05 + number)
    code = (
        "import sys\nfrom pathlib import Path\nfrom benchctl.history.history import history_of\n"
        "for _ in range(5):\n"
        "    Path(sys.argv[1], '.benchctl-history.sqlite').unlink(missing_ok=True)\n"
        "    found = history_of(Path(sys.argv[1]), 'all', lambda text: sys.exit(text))\n"
        "    print([point.value for point in found.units[0].figures[0].series.points])\n"
    )
    runs = [
        subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for _ in range(2)
    ]
    told = [run.communicate(timeout=50) for run in runs]
    assert [run.returncode for run in runs] == [0, 0], told
    lines = {line for out, _ in told for line in out.decode().splitlines()}
    assert lines == {str([point.value for point in figure(read(folder)).series.points])}
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == [NAME]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_where_the_folder_may_not_be_written_to_the_index_is_in_the_users_cache(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder.chmod(0o555)
    try:
        history = read(folder)
        assert history.index is not None
        assert history.index.parent == tmp_path / "cache" / "benchctl"
        assert read(folder) == history
        assert not (folder / NAME).exists()
    finally:
        folder.chmod(0o755)


def test_the_cache_has_one_index_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(os, "access", lambda *_: False)
    places = [place_of(tmp_path / name) for name in "ab"]
    assert places[0] != places[1]
    assert places[0] == place_of(tmp_path / "b" / ".." / "a")
    campaign(tmp_path / "a")
    assert read(tmp_path / "a").index == places[0]
    assert places[0].exists()


def test_a_folder_without_a_campaign_is_refused_and_left_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "bad.h5").write_bytes(b"no hdf5")
    with pytest.raises(UsageError, match=r"^mine: holds no campaign: .*\(bad\.h5: is not an HDF5 file"):
        history_of(tmp_path, "mine", print)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.h5"]


def test_a_folder_linked_into_itself_is_walked_once(folder: Path) -> None:
    (folder / "again").symlink_to(folder, target_is_directory=True)
    history = read(folder)
    assert len(only(history).campaigns) == 3
    assert history.problems == ()
