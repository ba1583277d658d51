"""What a worker makes of one job, in this process."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import replace
from pathlib import Path

import benchctl
from benchctl.app.fit import fit
from benchctl.fleet.job import Job, JobOutcome, kept, record_name
from benchctl.fleet.places import place_of
from benchctl.fleet.work import work
from benchctl.recordings.writer import write_recording
from tests.benchctl.diagnosis.made_drive import Truth, drive_channels
from tests.benchctl.diagnosis.made_recording import recording_of
from tests.benchctl.fleet.made import job_of, points


def do(job: Job) -> JobOutcome:
    return work(job, benchctl.__version__)


def test_the_results_are_those_of_the_single_verb_and_a_record_says_what_was_done(tmp_path: Path) -> None:
    path = points(tmp_path / "a.h5", 1)
    outcome = do(job_of(path))
    assert (outcome.state, outcome.reason) == ("done", "")
    fit([path], out=tmp_path / "single")
    for name in ("coefficients.json", "report.html"):
        assert (tmp_path / "a.fit" / name).read_bytes() == (tmp_path / "single" / name).read_bytes()
    record = json.loads((tmp_path / "a.fit" / record_name("fit")).read_text())
    assert (record["verb"], record["options"], record["version"]) == ("fit", {}, benchctl.__version__)
    assert record["files"] == ["coefficients.json", "report.html"]
    K0 = json.loads((tmp_path / "single" / "coefficients.json").read_text())["K0_v_per_dps"]
    assert outcome.record is not None
    assert {one.name: one.value for one in outcome.record.stated.figures}["K0_v_per_dps"] == K0
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.fit", "a.h5", "single"]


def test_a_diagnosis_is_of_the_part_that_the_recording_has(tmp_path: Path) -> None:
    drive = recording_of(drive_channels(Truth(coulomb=0.03), 1, seconds=30.0))
    write_recording(tmp_path / "drive.h5", drive.meta, drive.steps())
    job = replace(job_of(tmp_path / "drive.h5"), verb="diagnose")
    do(replace(job, place=place_of(job.recording, "diagnose", None)))
    assert json.loads((tmp_path / "drive.diagnosis" / "diagnosis.json").read_text())["part"] == "drive"


def test_what_is_fetched_is_fitted_alike_and_named_by_its_url(tmp_path: Path) -> None:
    path = points(tmp_path / "a.h5", 1)
    outcome = do(job_of(f"file://{path}", out=tmp_path / "out"))
    assert (outcome.state, outcome.reason) == ("done", "")
    (folder,) = (tmp_path / "out").iterdir()
    fit([path], out=tmp_path / "single")
    theirs, ours = (json.loads((one / "coefficients.json").read_text()) for one in (tmp_path / "single", folder))
    assert ours.pop("source") == [{**theirs.pop("source")[0], "recording": f"file://{path}"}]
    assert ours == theirs


def test_what_is_in_an_archive_is_fetched_and_kept_as_long_as_it_is_the_same(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(points(tmp_path / "a.h5", 1), "lab/a.h5")
    job = job_of(f"zip://lab/a.h5::{tmp_path}/all.zip", out=tmp_path / "out")
    outcome = do(job)
    assert (outcome.state, outcome.reason) == ("done", "")
    assert kept(job) is not None
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(points(tmp_path / "a.h5", 2), "lab/a.h5")
    assert kept(job_of(job.recording.where, out=tmp_path / "out")) is None


def test_a_job_is_kept_until_recording_or_results_change(tmp_path: Path) -> None:
    path = points(tmp_path / "a.h5", 1)
    assert kept(job_of(path)) is None
    do(job_of(path))
    outcome = kept(job_of(path))
    assert outcome is not None
    assert outcome.state == "kept"
    assert kept(job_of(path, again=True)) is None
    other = replace(job_of(path), options=replace(job_of(path).options, seed=1))
    assert kept(other) is not None  # a fit draws nothing
    (tmp_path / "a.fit" / "coefficients.json").write_text("{}")
    assert kept(job_of(path)) is None
    do(job_of(path))
    points(path, 2)
    assert kept(job_of(path)) is None
    assert do(job_of(path, run="next")).record != outcome.record
    assert kept(job_of(path)) is not None
    (tmp_path / "a.fit" / "report.html").unlink()
    assert kept(job_of(path)) is None


def test_a_recording_that_was_only_touched_is_not_done_again(tmp_path: Path) -> None:
    path = points(tmp_path / "a.h5", 1)
    do(job_of(path))
    written = (tmp_path / "a.fit" / "report.html").stat().st_mtime_ns
    os.utime(path, ns=(1, 1))
    assert kept(job_of(path)) is None
    assert do(job_of(path, run="next")).state == "kept"
    assert (tmp_path / "a.fit" / "report.html").stat().st_mtime_ns == written
    assert kept(job_of(path)) is not None


def test_a_damaged_record_is_none(tmp_path: Path) -> None:
    path = points(tmp_path / "a.h5", 1)
    do(job_of(path))
    record = tmp_path / "a.fit" / record_name("fit")
    whole = record.read_text()
    for damage in ("", "{", "[]", '{"schema": "benchctl-fleet-job/1"}', "\x00", whole.replace("-job/1", "-job/2")):
        record.write_text(damage)
        assert kept(job_of(path)) is None
    record.write_text(whole)
    assert kept(job_of(path)) is not None


def test_a_corrupt_recording_fails_in_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    path = points(tmp_path / "a.h5", 1)
    path.write_bytes(path.read_bytes()[:9000])
    outcome = do(job_of(path))
    assert outcome.state == "failed"
    assert str(path) in outcome.reason
    assert "\n" not in outcome.reason
    assert [one.name for one in tmp_path.iterdir()] == ["a.h5"]


def test_a_recording_that_a_worker_does_not_see_fails_without_making_folders(tmp_path: Path) -> None:
    job = job_of(points(tmp_path / "elsewhere" / "a.h5", 1))
    (tmp_path / "elsewhere" / "a.h5").unlink()
    (tmp_path / "elsewhere").rmdir()
    outcome = do(job)
    assert "is not there, as " in outcome.reason
    assert list(tmp_path.iterdir()) == []


def test_a_worker_of_another_version_does_nothing(tmp_path: Path) -> None:
    outcome = work(job_of(points(tmp_path / "a.h5", 1)), "0.0.1")
    assert outcome.reason.endswith(f"has benchctl {benchctl.__version__}, not 0.0.1")
    assert not (tmp_path / "a.fit").exists()


def test_what_is_done_in_a_run_is_not_done_twice_in_it_whatever_was_asked(tmp_path: Path) -> None:
    job = job_of(points(tmp_path / "a.h5", 1), again=True)
    assert do(job).state == "done"
    written = (tmp_path / "a.fit" / "report.html").stat().st_mtime_ns
    assert do(job).state == "done"  # as after the death of a worker that had finished it
    assert (tmp_path / "a.fit" / "report.html").stat().st_mtime_ns == written
    assert do(replace(job, run="next")).state == "done"
    assert (tmp_path / "a.fit" / "report.html").stat().st_mtime_ns > written
