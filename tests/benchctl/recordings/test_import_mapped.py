"""Tables and MAT files by a map: units, clocks, steps, and the faults of each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from benchctl.recordings.importing import import_recording, read_foreign
from benchctl.recordings.map_examples import example
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings.open_folder import rows, write_open

MAP_EXAMPLE_CSV = example("samples")

MAP = """\
[unit]
serial = "G1"
[time]
column = "t"
unit = "ms"
{time}
[channels.encoder_deg]
column = "angle"
unit = "deg"
sign = -1
[channels.gyro_v]
column = "out"
unit = "mV"
{rest}
"""


def table(tmp_path: Path, stamps: list[int], *, time: str = "", rest: str = "") -> tuple[Path, Path]:
    """A table whose angle turns 2° a millisecond and whose output is 1 mV a millisecond, and its map."""
    source, mapping = tmp_path / "log.csv", tmp_path / "map.toml"
    source.write_text("t,angle,out\n" + "".join(f"{t},{(2.0 * t) % 360},{t}\n" for t in stamps))
    mapping.write_text(MAP.format(time=time, rest=rest))
    return source, mapping


def test_the_example_of_the_help_imports_what_it_describes(tmp_path: Path) -> None:
    source, mapping = tmp_path / "log.csv", tmp_path / "map.toml"
    mapping.write_text(MAP_EXAMPLE_CSV, encoding="utf-8")
    lines = [f"{k * 10};{(-k * 100) % 65536};x;{k / 10};{296.15 + k / 1000};5,01" for k in range(4000)]
    text = "\n".join(["Lab °C", "12.03.", "Time (ms);Table;Note;Gyro;Housing;Supply", "ms;;;;K;V", *lines])
    source.write_bytes(text.replace(".", ",").encode("latin-1"))
    meta, (step,) = read_foreign(source, mapping)
    assert (step.info.kind, step.info.amplitude_dps, step.info.samples) == ("sine", 100.0, 4000)
    assert step["time_s"][-1] == pytest.approx(39.99)
    assert step["encoder_deg"][1] == pytest.approx(100 * 360 / 65536)
    assert step["gyro_v"][1000] == pytest.approx(1.0)
    assert step["gyro_temp_c"][0] == pytest.approx(23.0)
    assert step["supply_v"][0] == 5.01
    assert meta.extra["channel_units"]["supply_v"] == "V"
    assert meta.bench.sample_rate_hz == pytest.approx(100.0)
    assert meta.provenance["map"] == MAP_EXAMPLE_CSV


def test_a_clean_table_is_one_step_known_by_its_encoder(tmp_path: Path) -> None:
    meta, (step,) = read_foreign(*table(tmp_path, list(range(1000, 1400, 10))))
    assert (step.info.name, step.info.kind, step.info.sample_rate_hz) == ("recording", "motion", 100.0)
    assert step["time_s"][0] == 0
    assert meta.extra["time_origin_s"] == 1.0
    assert step["encoder_deg"][1] == pytest.approx((-2020.0) % 360)
    assert step["gyro_v"][0] == pytest.approx(1.0)


STAMPS = [t for t in range(0, 1000, 10) if t not in (500, 510, 700)]


def test_dirty_stamps_are_refused_unless_the_map_says_otherwise(tmp_path: Path) -> None:
    source, mapping = table(tmp_path, STAMPS)
    with pytest.raises(UsageError, match=r"log\.csv, line 52, column t: a gap: 0\.03 s .*time\.stamps"):
        read_foreign(source, mapping)


def test_repair_splits_at_gaps_and_says_so(tmp_path: Path) -> None:
    meta, steps = read_foreign(*table(tmp_path, STAMPS, time='stamps = "repair"'))
    assert [step.info.name for step in steps] == ["recording, part 1", "recording, part 2", "recording, part 3"]
    assert [step.info.samples for step in steps] == [50, 18, 29]
    assert [step["time_s"][0] for step in steps] == pytest.approx([0, 0.52, 0.71])
    assert "3 samples are missing in 2 gaps (after line 51, 69)" in meta.provenance["treatment"]
    told = json.loads(meta.provenance["treatment_json"])
    assert [(gap["after_row"], gap["missing"]) for gap in told["gaps"]] == [(51, 2), (69, 1)]


def test_a_fill_goes_along_the_turn_and_not_across_the_wrap(tmp_path: Path) -> None:
    stamps = [t for t in range(0, 1000, 10) if t != 180]
    meta, (step,) = read_foreign(*table(tmp_path, stamps, time='stamps = "repair"\ngaps = "fill"'))
    assert step["filled"].tolist() == [float(k == 18) for k in range(100)]
    assert step["encoder_deg"] == pytest.approx(np.mod(-20.0 * np.arange(100), 360))
    assert step["gyro_v"] == pytest.approx(np.arange(100) / 100)
    assert meta.extra["channel_units"]["filled"] == "1"


def test_the_rate_of_an_encoder_adds_up_to_its_angle(tmp_path: Path) -> None:
    turns = np.array([0.0, 10.0, 350.0, 20.0, -30.0]) / 6.0  # rpm, each over the 100 ms before
    source = tmp_path / "rates.csv"
    source.write_text("\n".join(["turning,volts", *[f"{turn:.9f},0.1" for turn in turns]]))
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        '[unit]\nserial = "A"\n[time]\nrate_hz = 10\n'
        '[channels.encoder_deg]\ncolumn = "turning"\nunit = "rpm"\nsign = -1\n'
        '[channels.gyro_v]\ncolumn = "volts"\nunit = "V"\n'
    )
    meta, (step,) = read_foreign(source, mapping)
    assert step["encoder_deg"] == pytest.approx([0.0, 359.0, 324.0, 322.0, 325.0])
    assert meta.extra["channel_units"]["encoder_deg"] == "degree"


def test_kept_stamps_are_not_called_uniform(tmp_path: Path) -> None:
    meta, (step,) = read_foreign(*table(tmp_path, [0, 10, 25, 26, 60], time='stamps = "keep"'))
    assert step["time_s"].tolist() == [0.0, 0.01, 0.025, 0.026, 0.06]
    assert step.info.sample_rate_hz is None
    assert meta.bench.sample_rate_hz == 0
    assert "not uniform" in meta.provenance["treatment"]


def test_a_stated_rate_is_checked(tmp_path: Path) -> None:
    source, mapping = table(tmp_path, list(range(0, 1000, 10)), rest="[bench]\nsample_rate_hz = 50")
    with pytest.raises(UsageError, match=r"line 4, column t: the stamp 0\.02 s is not uniform at 50 Hz"):
        read_foreign(source, mapping)


def test_a_file_without_stamps_takes_the_rate_of_the_map(tmp_path: Path) -> None:
    source, mapping = table(tmp_path, list(range(0, 100, 10)))
    mapping.write_text(mapping.read_text().replace('column = "t"\nunit = "ms"', "rate_hz = 4"))
    _, (step,) = read_foreign(source, mapping)
    assert step["time_s"].tolist() == [k / 4 for k in range(10)]


def test_steps_of_the_map_cut_the_table(tmp_path: Path) -> None:
    listed = (
        '[[steps]]\nname = "rest"\nkind = "static"\nt_end = 0.2\n'
        '[[steps]]\nname = "go"\nkind = "motion"\nt_start = 0.5\n'
    )
    _, steps = read_foreign(*table(tmp_path, list(range(0, 1000, 10)), rest=listed))
    assert [(step.info.kind, step.info.samples) for step in steps] == [
        ("static", 20),
        ("unassigned", 30),
        ("motion", 50),
    ]


def test_steps_that_overlap_are_named_with_the_map(tmp_path: Path) -> None:
    listed = '[[steps]]\nname = "rest"\nkind = "static"\n[[steps]]\nname = "go"\nkind = "motion"\nt_start = 0.5\n'
    with pytest.raises(UsageError, match=r"map\.toml, steps\[1\]: 'go' starts at 0\.5 s, before 'rest' ends at 1 s"):
        read_foreign(*table(tmp_path, list(range(0, 1000, 10)), rest=listed))


def test_an_open_folder_with_other_names_takes_the_rest_from_its_description(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench", header="time_s,angle,gyro_v,gyro_temp_c,chamber_temp_c", body=rows())
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        '[time]\ncolumn = "time_s"\n[channels.encoder_deg]\ncolumn = "angle"\nunit = "rad"\n'
        '[channels.gyro_v]\ncolumn = "gyro_v"\nunit = "V"\n'
    )
    meta, steps = read_foreign(folder, mapping)
    assert meta.unit.serial == "DUT-1"
    assert meta.bench.adc_bits == 16
    assert meta.simulation is not None
    assert [step.info.name for step in steps][:2] == ["rest", "turn"]
    assert steps[0]["encoder_deg"][1] == pytest.approx(np.rad2deg(2.0))


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (("out\n", "volts\n"), r"log\.csv, line 1: the column 'out' of the map is missing among 't', 'angle', 'volts'"),
        (("\n30,60.0,30\n", "\n30,60.0,?\n"), r"log\.csv, line 5, column out: expected a number, got '\?'"),
        (("\n30,60.0,30\n", "\n30,60.0\n"), r"log\.csv, line 5: expected at least 3 cells, got 2 cells"),
        (("\n30,60.0,30\n", "\n30,nan,30\n"), r"log\.csv, line 5, column angle: expected a finite number"),
        (("\n30,60.0,30\n", "\n5,60.0,30\n"), r"log\.csv, line 5, column t: the stamp 0\.005 s goes back from 0\.02"),
    ],
)
def test_a_fault_in_a_table_is_named_by_line_and_column(tmp_path: Path, spoil: tuple[str, str], says: str) -> None:
    source, mapping = table(tmp_path, list(range(0, 1000, 10)))
    source.write_text(source.read_text().replace(*spoil, 1))
    with pytest.raises(UsageError, match=says):
        import_recording(source, mapping, tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


def test_a_map_without_a_unit_is_refused(tmp_path: Path) -> None:
    source, mapping = table(tmp_path, list(range(0, 1000, 10)))
    mapping.write_text(mapping.read_text().replace('[unit]\nserial = "G1"\n', ""))
    with pytest.raises(UsageError, match=r"map\.toml: \[unit\] is needed"):
        read_foreign(source, mapping)


MAT_MAP = """\
[unit]
serial = "G1"
[file]
first_row_variable = "first"
[time]
column = "log"
index = 1
[channels.gyro_v]
column = "log"
index = 2
unit = "V"
[channels.current_a]
column = "amps"
unit = "A"
"""


def mat(tmp_path: Path, **changes: object) -> tuple[Path, Path]:
    """A MAT file of a matrix and a vector, and its map."""
    source, mapping = tmp_path / "log.mat", tmp_path / "map.toml"
    log = np.column_stack([np.arange(100) / 50, np.arange(100.0)])
    savemat(source, {"first": 11, "log": log, "amps": np.arange(100, dtype=np.int16)} | changes)
    mapping.write_text(MAT_MAP)
    return source, mapping


def test_a_mat_file_begins_where_its_variable_says(tmp_path: Path) -> None:
    _, (step,) = read_foreign(*mat(tmp_path))
    assert step["gyro_v"][0] == 10
    assert step["current_a"].tolist() == list(range(10, 100))
    assert step.info.sample_rate_hz == 50


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"amps": "text"}, "amps is not a column of numbers"),
        ({"amps": np.zeros((100, 2))}, "amps is a matrix of 100 by 2; say index"),
        ({"log": np.zeros((100, 1))}, "log has 1 columns, the map asks for 2"),
        ({"amps": np.zeros(99)}, "different numbers of rows"),
        ({"first": 101}, "has 100 rows, none from row 101"),
        ({"first": [1, 2]}, "first should hold one row number"),
        ({"amps": np.r_[np.zeros(50), np.nan, np.zeros(49)]}, "row 51, column amps: expected a finite number, got nan"),
    ],
)
def test_a_fault_in_a_mat_file_is_named(tmp_path: Path, changes: dict[str, object], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        read_foreign(*mat(tmp_path, **changes))


def test_a_missing_variable_is_named_beside_those_that_are_there(tmp_path: Path) -> None:
    source, mapping = mat(tmp_path)
    mapping.write_text(MAT_MAP.replace('"amps"', '"volts"'))
    with pytest.raises(UsageError, match=r"'volts' of the map is missing among first, log, amps"):
        read_foreign(source, mapping)


@pytest.mark.parametrize("size", [0, 60, 400, 1500])
def test_a_mat_file_that_is_cut_short_is_refused(tmp_path: Path, size: int) -> None:
    source, mapping = mat(tmp_path)
    source.write_bytes(source.read_bytes()[:size])
    with pytest.raises(UsageError, match=r"log\.mat"):
        read_foreign(source, mapping)


def test_a_mat_file_of_version_7_3_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    source, mapping = mat(tmp_path)
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    source.write_bytes(header + bytes(384) + b"\x89HDF\r\n\x1a\n" + bytes(64))
    with pytest.raises(UsageError, match=r"log\.mat: not a MAT file of version 7\.3, or cut short"):
        read_foreign(source, mapping)
