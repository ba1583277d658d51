"""Tables of static points, with a map and without."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.recordings.importing import import_recording, read_foreign
from benchctl.recordings.map_examples import example
from benchctl.recordings.static_points import StaticPoints
from benchctl_instruments.errors import UsageError
from tests.shared import SHARED, needs_shared

MAP_EXAMPLE_POINTS = example("points")

TABLE = "run,unit,rate_dps,gyro_v_mean,gyro_v_std\n1,G7,-50,3.0,0.02\n1,G7,0,0.15,0.004\n2,G7,50,-2.65,0.05\n"


def table(tmp_path: Path, text: str = TABLE) -> Path:
    source = tmp_path / "points.csv"
    source.write_text(text)
    return source


def test_a_table_with_our_names_needs_no_map(tmp_path: Path) -> None:
    meta, (step,) = read_foreign(table(tmp_path))
    assert step.info.kind == "static_points"
    assert meta.unit.serial == "G7"
    points = StaticPoints.from_step(step)
    assert points.rate_dps.tolist() == [-50, 0, 50]
    assert points.mean_v.tolist() == [3.0, 0.15, -2.65]
    assert points.run is not None
    assert points.run.tolist() == [1, 1, 2]
    assert points.temperature_c is None
    assert step["time_s"].tolist() == [0, 1, 2]


def test_a_map_adds_what_the_table_does_not_say(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text(MAP_EXAMPLE_POINTS)
    meta, (step,) = read_foreign(table(tmp_path), mapping)
    points = StaticPoints.from_step(step)
    assert points.duration_s is not None
    assert points.duration_s.tolist() == [10, 10, 10]
    assert meta.extra["samples_per_point"] == 10000
    assert (meta.unit.model, meta.unit.range_dps) == ("VG910", 100)


def test_points_go_through_a_step_and_back() -> None:
    points = StaticPoints(
        rate_dps=np.array([-1.0, 1.0]), mean_v=np.array([0.1, 0.2]), temperature_c=np.array([20.0, 21.0])
    )
    back = StaticPoints.from_step(points.to_step())
    assert (back.rate_dps.tolist(), back.mean_v.tolist(), back.std_v) == ([-1, 1], [0.1, 0.2], None)
    assert back.temperature_c is not None
    assert back.temperature_c.tolist() == [20, 21]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (
            ("0.004", "-0.004"),
            r"points\.csv, line 3, column gyro_v_std: a standard deviation below 0, expected 0 or more",
        ),
        (("0.15", "nan"), r"points\.csv, line 3, column gyro_v_mean: expected a finite number"),
        (("gyro_v_mean", "volts"), r"points\.csv: which column is which is not known; name a map file"),
    ],
)
def test_a_fault_is_named(tmp_path: Path, spoil: tuple[str, str], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        import_recording(table(tmp_path, TABLE.replace(*spoil)), None, tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


def test_points_at_one_rate_calibrate_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="all points are at one rate"):
        read_foreign(table(tmp_path, TABLE.replace("-50,", "0,").replace(",50,", ",0,")))


@needs_shared("data/vg910")
def test_the_vg910_points_arrive_whole(tmp_path: Path) -> None:
    source = SHARED / "data" / "vg910" / "unit1_static_points.csv"
    done = import_recording(source, None, tmp_path / "vg910.h5")
    assert (done.steps, done.samples, done.meta.unit.serial) == (1, 33, "1")
    points = StaticPoints.from_step(read_foreign(source)[1][0])
    assert points.run is not None
    assert np.unique(points.run).tolist() == [33, 41, 49]
    slope, offset = np.polyfit(points.rate_dps, points.mean_v, 1)
    misfit = float(np.std(points.mean_v - slope * points.rate_dps - offset)) / abs(slope)
    assert 3.0 < misfit < 5.0  # deg/s; a straight line does not do
