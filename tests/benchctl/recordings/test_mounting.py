"""How a unit was mounted, in recordings: written only where it was across, and the same after every round trip."""

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import h5py
import pytest
from scipy.io import loadmat

from benchctl.cli.show import _line
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.exporting import export_csv, export_mat, export_open
from benchctl.recordings.gather import combine, take_apart
from benchctl.recordings.import_open import read_open_recording
from benchctl.recordings.model import Step, StepInfo
from benchctl.recordings.reader import join, open_recording
from benchctl.recordings.recover import reopen
from benchctl.recordings.verify import summarise, verify
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings.made import info, meta, polled, same, step, streamed


def along(index: int) -> Step:
    return _with_air(step(index))


def across(index: int) -> Step:
    return _with_air(step(index, mounting="across", role="none", name=f"rate {index:+d}, across"))


def cycle(index: int) -> Step:
    start = 100.0 * index
    changes = {"kind": "power_cycle", "role": "none", "sample_rate_hz": None, "rate_dps": None}
    return Step(info(index, t_start=start, t_end=start + 60.0, name="power cycle", **changes), polled(start))


def _with_air(one: Step) -> Step:
    return Step(one.info, {**one.channels, "chamber_temp_c": one["gyro_temp_c"].copy()})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "r.h5"
    write_recording(path, meta(), [along(1), cycle(2), across(3)])
    return path


def test_it_is_read_back_and_of_a_unit_along_nothing_is_written(path: Path) -> None:
    with h5py.File(path) as file:
        assert "mounting" not in file["steps/0001"].attrs
        assert "mounting" not in file["steps/0002"].attrs
        assert file["steps/0003"].attrs["mounting"] == "across"
    assert verify(path) == []
    with open_recording(path) as recording:
        assert [one.mounting for one in recording.infos] == ["", "", "across"]
        assert [one.kind for one in recording.infos] == ["constant_rate", "power_cycle", "constant_rate"]
        assert [same(recording.step(1), along(1)), same(recording.step(3), across(3))] == [True, True]


def test_the_digest_of_a_step_says_how_the_unit_was_mounted(tmp_path: Path) -> None:
    one, other = along(1), replace(along(1).info, mounting="across")
    for name, written in (("a.h5", one), ("b.h5", Step(other, one.channels))):
        write_recording(tmp_path / name, meta(), [written])
    with open_recording(tmp_path / "a.h5") as first, open_recording(tmp_path / "b.h5") as second:
        assert first.infos[0].digest != second.infos[0].digest
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        del file["steps/0001"].attrs["mounting"]
    assert verify(tmp_path / "b.h5")


def test_it_survives_a_campaigns_folder_taking_apart_combining_and_joining(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "steps"
    folder.mkdir()
    take_apart(path, folder, meta())
    combine(sorted(folder.iterdir()), tmp_path / "again.h5", meta())
    with open_recording(path) as one, open_recording(tmp_path / "again.h5") as other:
        assert one.infos == other.infos
        assert [info.mounting for info in join([one, other]).infos] == ["", "", "across"] * 2


def test_a_step_that_was_cut_stays_what_it_was_when_the_campaign_is_opened_again(tmp_path: Path) -> None:
    writer = CampaignWriter(tmp_path / "c", meta(status="running"))
    begun = replace(across(1).info, whole=False)
    into = writer.begin_step(begun, tuple(streamed(0.0, 1)))
    into.append(streamed(100.0, 50))
    writer.finish("interrupted", "Ctrl-C")
    from benchctl.recordings.campaign_folder import campaign_lock

    lock = campaign_lock(tmp_path / "c")
    lock.acquire("test")
    writer, infos = reopen(tmp_path / "c", 3, lock)
    writer.release()
    assert [(one.index, one.mounting, one.whole, one.is_cut_attempt) for one in infos] == [(4, "across", False, True)]


def test_exports_say_it_of_the_steps_across_alone(path: Path, tmp_path: Path) -> None:
    with open_recording(path) as recording:
        export_csv(recording, tmp_path / "csv")
        export_mat(recording, tmp_path / "r.mat")
    told = json.loads((tmp_path / "csv" / "recording.json").read_text(encoding="utf-8"))
    assert [one.get("mounting") for one in told["steps"]] == [None, None, "across"]
    structs = loadmat(tmp_path / "r.mat", simplify_cells=True)
    assert "mounting" not in structs["step_0001"]
    assert structs["step_0003"]["mounting"] == "across"


def test_an_open_recording_carries_it_there_and_back(path: Path, tmp_path: Path) -> None:
    with open_recording(path) as recording:
        export_open(recording, tmp_path / "open")
    _, steps = read_open_recording(tmp_path / "open")
    found = [(one.info.name, one.info.mounting, one.info.role) for one in steps]
    assert found == [("rate +1", "", "fit"), ("rate +3, across", "across", "none")]
    document = json.loads((tmp_path / "open" / "recording.json").read_text(encoding="utf-8"))
    assert "mounting" not in document["steps"][0]
    document["steps"][1]["role"] = "fit"
    (tmp_path / "open" / "recording.json").write_text(json.dumps(document))
    assert read_open_recording(tmp_path / "open")[1][1].info.role == "none"
    document["steps"][1]["mounting"] = "sideways"
    (tmp_path / "open" / "recording.json").write_text(json.dumps(document))
    with pytest.raises(UsageError, match=r"steps\[1\].mounting: expected 'along', 'across', 'x up', .* got 'sideways'"):
        read_open_recording(tmp_path / "open")


def test_show_lists_it(path: Path) -> None:
    with closing(open_recording(path)) as recording:
        steps = summarise(recording)["steps"]
    assert [one.get("mounting") for one in steps] == [None, None, "across"]
    assert "power cycle" in _line(steps[1])
    assert "power_cycle    none " in _line(steps[1])
    assert "rate +3, across" in _line(steps[2])


@pytest.mark.parametrize(
    ("kind", "mounting", "whole", "cut", "left_out"),
    [
        ("soak", "", True, False, False),
        ("soak", "", False, False, False),
        ("soak", "across", True, False, True),
        ("power_cycle", "", True, False, True),
        ("mount", "", False, False, True),
        ("mount", "across", True, False, True),
        ("static", "across", True, False, True),
        ("static", "", False, True, True),
        ("unassigned", "", True, False, False),
    ],
)
def test_what_no_diagnosis_may_see(kind: str, mounting: str, whole: bool, cut: bool, left_out: bool) -> None:
    one: StepInfo = info(1, kind=kind, mounting=mounting, whole=whole, role="none")
    assert (one.is_cut_attempt, one.is_left_out) == (cut, left_out)
