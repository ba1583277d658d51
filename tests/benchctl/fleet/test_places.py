"""Where results land, and that they land whole."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from benchctl.fleet.located import Kind, Located
from benchctl.fleet.places import LocalPlace, Place, RemotePlace, place_of
from benchctl.recordings.campaign_manifest import write_manifest
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError


def recording(where: str, kind: Kind = "file") -> Located:
    return Located(where=where, kind=kind, size=1, stamp=())


def results(folder: Path, **files: str) -> Path:
    """A folder of results with a record."""
    folder.mkdir()
    for name, content in {"record": "r", **files}.items():
        (folder / name).write_text(content)
    return folder


@pytest.mark.parametrize(
    ("where", "kind", "lands"),
    [
        ("/lab/a.h5", "file", "/lab/a.fit"),
        ("/lab/a.hdf5", "file", "/lab/a.hdf5.fit"),
        ("/lab/unit17", "campaign", "/lab/unit17"),
        ("/lab/a", "open", "/lab/a.open.fit"),
        ("s3://lab/a.h5", "file", "s3://lab/a.fit"),
        ("s3://lab/unit17", "campaign", "s3://lab/unit17.fit"),
    ],
)
def test_results_land_beside_their_recording_and_a_campaigns_in_it(where: str, kind: Kind, lands: str) -> None:
    assert place_of(recording(where, kind), "fit", None).where == lands


def test_the_folders_of_the_verbs_are_called_as_those_of_the_single_ones() -> None:
    assert place_of(recording("/lab/a.h5"), "diagnose", None).where == "/lab/a.diagnosis"
    assert place_of(recording("/lab/a.h5"), "accept", None).where == "/lab/a.acceptance"


def test_in_one_folder_for_all_two_recordings_of_one_name_do_not_meet_and_names_last() -> None:
    first, second = (place_of(recording(f"/lab/{day}/a.h5"), "fit", "/out").where for day in ("monday", "tuesday"))
    assert first != second
    assert all(Path(where).parent == Path("/out") and Path(where).name.startswith("a-") for where in (first, second))
    assert place_of(recording("/lab/monday/a.h5"), "fit", "/out/").where == first
    assert place_of(recording("/lab/monday/a.h5"), "fit", "gs://out").where == f"gs://out/{Path(first).name}"


@pytest.fixture(params=["local", "remote"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Place:
    """A folder of results that is not there yet."""
    where = str(tmp_path / "a.fit")
    return LocalPlace(where) if request.param == "local" else RemotePlace(f"file://{where}")


def test_a_place_takes_a_folder_over_and_gives_its_files_back(place: Place, tmp_path: Path) -> None:
    assert (place.names(), place.read("report")) == (set(), None)
    place.land(results(tmp_path / "made", report="hello"), "record", set())
    assert (place.names(), place.read("report")) == ({"record", "report"}, b"hello")
    assert {path.name for path in tmp_path.iterdir()} == {"made", "a.fit"}


def test_results_are_replaced_one_by_one_and_what_people_keep_there_stays(place: Place, tmp_path: Path) -> None:
    place.land(results(tmp_path / "made", report="old", model="gone"), "record", set())
    place.put("notes.txt", b"mine")
    place.land(results(tmp_path / "again", report="new"), "record", {"report", "model"})
    assert place.names() == {"record", "report", "notes.txt"}
    assert (place.read("report"), place.read("notes.txt")) == (b"new", b"mine")


def test_a_landing_that_is_refused_leaves_no_record_behind(tmp_path: Path) -> None:
    folder = tmp_path / "a.fit"
    place = LocalPlace(str(folder))
    place.land(results(tmp_path / "made", report="old"), "record", set())
    (folder / "report").unlink()
    (folder / "report").mkdir()
    with pytest.raises(UsageError, match="cannot be written"):
        place.land(results(tmp_path / "again", report="new"), "record", set())
    assert place.read("record") is None


@pytest.mark.slow
def test_two_that_land_in_one_place_at_once_leave_one_whole_folder(tmp_path: Path) -> None:
    made = [results(tmp_path / f"made{number}", report="r" * 100_000, page="p") for number in range(20)]
    place = LocalPlace(str(tmp_path / "a.fit"))
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        list(pool.map(place.land, made, ["record"] * len(made), [set()] * len(made)))
    assert {path.name: path.stat().st_size for path in (tmp_path / "a.fit").iterdir()} == {
        "page": 1,
        "record": 1,
        "report": 100_000,
    }
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("where", ["http://lab/a.h5", "https://lab/a.h5", "zip://a.h5::file:///lab/a.zip"])
def test_where_nothing_can_be_written_beside_a_recording_a_folder_for_all_is_asked_for(where: str) -> None:
    with pytest.raises(UsageError, match=r"a\.h5.*: nothing can be written next to it; give --out"):
        place_of(recording(where), "fit", None)
    assert Path(place_of(recording(where), "fit", "/out").where).name.startswith("a-")


def test_results_in_a_campaigns_folder_are_in_its_manifest(tmp_path: Path) -> None:
    campaign = tmp_path / "unit17"
    campaign.mkdir()
    (campaign / "journal.jsonl").write_text("{}")
    write_manifest(campaign)
    made = results(tmp_path / "made", **{"report.html": "hello"})
    (made / "record").rename(made / ".record")
    LocalPlace(str(campaign)).land(made, ".record", set())
    assert (campaign / ".record").exists()
    assert verify(campaign) == []
