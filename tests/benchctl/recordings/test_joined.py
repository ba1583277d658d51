from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from benchctl.recordings.model import Unit
from benchctl.recordings.reader import APART_S, join, open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made


def two(folder: Path) -> tuple[Path, Path]:
    paths = []
    for name in ("one", "other"):
        (folder / name).mkdir()
        paths.append(made.recording(folder / name, 2))
    return paths[0], paths[1]


def test_one_recording_is_itself(tmp_path: Path) -> None:
    with open_recording(made.recording(tmp_path)) as recording:
        assert join([recording]) is recording


def test_the_steps_of_two_are_numbered_on_a_day_apart(tmp_path: Path) -> None:
    with ExitStack() as stack:
        recordings = [stack.enter_context(open_recording(path)) for path in two(tmp_path)]
        joined = join(recordings)
        assert [info.index for info in joined.infos] == [1, 2, 3, 4]
        first_end = recordings[0].infos[-1].t_end
        shift_s = first_end + APART_S
        moved, origin = joined.step(3), recordings[1].step(1)
        assert moved.info.t_start == origin.info.t_start + shift_s
        assert np.array_equal(moved["time_s"], origin["time_s"] + shift_s)
        assert np.array_equal(moved["poll_time_s"], origin["poll_time_s"] + shift_s)
        assert np.array_equal(moved["gyro_v"], origin["gyro_v"])
        assert np.array_equal(joined.step(2)["time_s"], recordings[0].step(2)["time_s"])
        assert [step.info.index for step in joined.steps()] == [1, 2, 3, 4]
        assert joined.starts_s == (0.0, shift_s)
        assert joined.channels(4) == recordings[1].channels(2)
        assert set(joined.step(4, ["gyro_v"]).channels) == {"gyro_v"}


def test_recordings_of_different_units_are_not_read_as_one(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    paths = [
        made.recording(tmp_path / "a"),
        made.recording(tmp_path / "b", unit=Unit(serial="VG-8", range_dps=150.0)),
    ]
    with ExitStack() as stack:
        recordings = [stack.enter_context(open_recording(path)) for path in paths]
        with pytest.raises(UsageError, match="different units: VG-7, VG-8"):
            join(recordings)
