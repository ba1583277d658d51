"""Which of all that globs match are recordings."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import pytest

from benchctl.fleet.located import Located, located
from benchctl_instruments.errors import UsageError


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A campaign, one that is not finished, an open recording, lone files, and much that is none."""
    for name in (
        "one/recording.h5",
        "one/journal.jsonl",
        "one/steps/0001_rest.h5",
        "died/campaign.h5",
        "died/steps/0001_rest.h5",
        "died/steps/0002_rate.h5.part",
        "died/unreadable/0003_rate.h5",
        "theirs/recording.json",
        "theirs/samples.csv.gz",
        "deep/down/lone.h5",
        "deep/README.md",
        "lone.fit/report.html",
        "lone.h5",
        "[1].h5",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    return tmp_path


def found(*globs: str | Path) -> dict[str, Located]:
    recordings, _ = located([str(glob) for glob in globs])
    return {recording.where: recording for recording in recordings}


def test_below_a_folder_every_recording_is_found_once_and_no_file_of_a_campaign_by_itself(lab: Path) -> None:
    names = [str(lab / name) for name in ("[1].h5", "deep/down/lone.h5", "died", "lone.h5", "one", "theirs")]
    assert list(found(lab / "**")) == names
    assert list(found(lab / "**", lab / "one" / "recording.h5", lab / "one")) == names


def test_each_kind_has_its_files_in_its_stamp(lab: Path) -> None:
    recordings = found(lab / "**")
    kinds = {Path(where).name: (one.kind, [line.split()[0] for line in one.stamp]) for where, one in recordings.items()}
    assert kinds["one"] == ("campaign", ["recording.h5"])
    assert kinds["died"] == ("campaign", ["campaign.h5", "steps/0001_rest.h5", "steps/0002_rate.h5.part"])
    assert kinds["theirs"] == ("open", ["recording.json", "samples.csv.gz"])
    assert kinds["[1].h5"] == ("file", ["[1].h5"])


def test_a_stamp_tells_a_file_of_the_same_size_that_was_written_again(lab: Path) -> None:
    before = found(lab / "lone.h5")[str(lab / "lone.h5")].stamp
    assert found(lab / "lone.h5")[str(lab / "lone.h5")].stamp == before
    (lab / "lone.h5").write_text("LONE.H5")
    os.utime(lab / "lone.h5", ns=(1, 1))
    assert found(lab / "lone.h5")[str(lab / "lone.h5")].stamp != before


def test_a_link_to_a_recording_is_not_a_second_one(lab: Path) -> None:
    (lab / "latest").symlink_to(lab / "one")
    assert len(found(lab / "one", lab / "latest")) == 1


def test_paths_that_are_no_recordings_are_left_out_and_told_but_not_what_a_pattern_brings_along(lab: Path) -> None:
    recordings, others = located([str(lab / "lone.h5"), str(lab / "deep" / "README.md"), str(lab / "*")])
    assert len(recordings) == 5
    assert others == [str(lab / "deep" / "README.md")]


def test_globs_that_match_nothing_or_no_recording_are_refused_with_what_to_do(lab: Path) -> None:
    with pytest.raises(UsageError, match=r"no/\*\.h5: matches nothing; expected recordings: paths, patterns such as"):
        located([str(lab / "no" / "*.h5"), str(lab / "lone.h5")])
    with pytest.raises(UsageError, match=r"no recording there; .*; for all below a folder: '.*/\*\*'$"):
        located([str(lab)])
    with pytest.raises(UsageError, match=r"no recording there; expected \*\.h5, [^;]*$"):
        located([str(lab / "deep" / "README.md")])


def test_urls_are_found_alike_and_named_by_their_url(lab: Path) -> None:
    there = found(f"file://{lab}/**")
    names = [one.where for one in found(lab / "**").values()]
    assert list(there) == [f"file://{name}" for name in names]
    assert {where.removeprefix("file://"): one.kind for where, one in there.items()} == {
        where: one.kind for where, one in found(lab / "**").items()
    }
    assert all(one.remote and one.stamp for one in there.values())


def test_what_is_in_an_archive_is_named_with_it_and_by_its_whole_path(
    lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with zipfile.ZipFile(lab / "all.zip", "w") as archive:
        for name in ("one/recording.h5", "lone.h5", "deep/README.md"):
            archive.write(lab / name, name)
    monkeypatch.chdir(lab)
    for globs in (["zip://**::all.zip"], ["zip://lone.h5::all.zip", f"zip://one::file://{lab}/all.zip"]):
        there = found(*globs)
        assert {where: (one.kind, one.name, len(one.stamp)) for where, one in there.items()} == {
            f"zip://lone.h5::file://{lab}/all.zip": ("file", "lone", 1),
            f"zip://one::file://{lab}/all.zip": ("campaign", "one", 1),
        }


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("nosuch://lab/*.h5", "cannot be reached or read: protocol not known: nosuch"),
        ("file:///nowhere/*.h5", "matches nothing"),
        ("s3://lab/*.h5", "s3fs"),
    ],
)
def test_urls_that_cannot_be_used_are_refused_in_one_line(url: str, says: str) -> None:
    with pytest.raises(UsageError, match=says) as refused:
        located([url])
    assert "\n" not in str(refused.value)
