"""Open recordings as they should be."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.recordings.import_open import read_open_recording
from benchctl.recordings.text_file import Layout, body_of, printed_decimals
from tests.benchctl.recordings.open_folder import HEADER, description, rows, write_open


def test_every_row_is_in_exactly_one_step(tmp_path: Path) -> None:
    _, steps = read_open_recording(write_open(tmp_path / "bench"))
    assert [step.info.kind for step in steps] == ["static", "constant_rate", "unassigned"]
    assert [step.info.samples for step in steps] == [10, 20, 10]
    assert np.concatenate([step["time_s"] for step in steps]).tolist() == [k / 10 for k in range(40)]


def test_rows_of_no_step_are_kept_apart_from_fits(tmp_path: Path) -> None:
    _, steps = read_open_recording(write_open(tmp_path / "bench", steps=[]))
    (only,) = steps
    assert (only.info.kind, only.info.role, only.info.samples) == ("unassigned", "none", 40)
    assert math.isnan(only.info.chamber_setpoint_c)


def test_what_the_description_says_arrives(tmp_path: Path) -> None:
    meta, steps = read_open_recording(write_open(tmp_path / "bench"))
    assert (meta.unit.serial, meta.unit.range_dps) == ("DUT-1", 150.0)
    assert (meta.bench.encoder_counts_per_rev, meta.bench.adc_bits, meta.bench.latitude_deg) == (65536, 16, 58.5)
    assert meta.simulation == description()["simulation"]
    assert (steps[1].info.name, steps[1].info.rate_dps, steps[1].info.t_start, steps[1].info.t_end) == (
        "turn",
        20,
        1,
        3,
    )
    assert meta.status == "imported"
    assert set(json.loads(meta.provenance["sources"])) == {"recording.json", "samples.csv.gz"}


def test_decimals_are_kept_where_they_give_the_text_back(tmp_path: Path) -> None:
    meta, _ = read_open_recording(write_open(tmp_path / "bench"))
    assert meta.extra["csv_decimals"] == {
        "time_s": 6,
        "encoder_deg": 7,
        "gyro_v": 6,
        "gyro_temp_c": 3,
        "chamber_temp_c": 2,
    }


@pytest.mark.parametrize("cell", ["23", "23.0", "2.3e1", "+23.00", " 23.00", "023.00"])
def test_one_cell_that_is_printed_otherwise_forfeits_its_columns_decimals(tmp_path: Path, cell: str) -> None:
    body = rows()
    body[7] = body[7].rpartition(",")[0] + f",{cell}"
    meta, _ = read_open_recording(write_open(tmp_path / "bench", body=body))
    assert set(meta.extra["csv_decimals"]) == {"time_s", "encoder_deg", "gyro_v", "gyro_temp_c"}


def test_a_plain_csv_with_dos_lines_and_other_order_is_the_same_recording(tmp_path: Path) -> None:
    reference = read_open_recording(write_open(tmp_path / "bench"))[1]
    folder = write_open(tmp_path / "plain")
    (folder / "samples.csv.gz").unlink()
    swapped = [",".join([*line.split(",")[1:], line.split(",")[0]]) for line in [HEADER, *rows()]]
    (folder / "samples.csv").write_bytes(b"\xef\xbb\xbf" + "\r\n".join(swapped).encode())
    meta, steps = read_open_recording(folder)
    assert meta.extra["csv_columns"][-1] == "time_s"
    for step, expected in zip(steps, reference, strict=True):
        assert {name: values.tolist() for name, values in step.channels.items()} == {
            name: values.tolist() for name, values in expected.channels.items()
        }


def test_columns_and_keys_without_a_name_of_ours_are_kept(tmp_path: Path) -> None:
    raw = description(operator="N. N.")
    raw["steps"][1]["remark"] = "vibration"
    body = [f"{line},5.01" for line in rows()]
    meta, steps = read_open_recording(write_open(tmp_path / "bench", header=f"{HEADER},supply_v", body=body, **raw))
    assert steps[1]["supply_v"].tolist() == [5.01] * 20
    assert meta.extra["channel_units"] == {"supply_v": "V"}
    assert meta.extra["foreign_keys"] == {"recording": {"operator": "N. N."}, "steps": {"2": {"remark": "vibration"}}}


def test_a_set_point_and_a_model_that_nobody_knows_may_be_null(tmp_path: Path) -> None:
    raw = description(simulation=None)
    raw["steps"][0]["chamber_setpoint_c"] = None
    raw["unit"]["model"] = "VG910Q"
    meta, steps = read_open_recording(write_open(tmp_path / "bench", **raw))
    assert math.isnan(steps[0].info.chamber_setpoint_c)
    assert meta.simulation is None
    assert meta.unit.model == "VG910Q"


def test_steps_may_be_listed_in_any_order(tmp_path: Path) -> None:
    listed = description()["steps"]
    _, steps = read_open_recording(write_open(tmp_path / "bench", steps=listed[::-1]))
    assert [step.info.name for step in steps][:2] == ["rest", "turn"]
    assert [step.info.index for step in steps] == [1, 2, 3]


def test_stamps_rounded_to_the_millisecond_are_uniform_all_the_same(tmp_path: Path) -> None:
    bench = description()["bench"] | {"sample_rate_hz": 128.0}
    body = [f"{k / 128:.3f},1.0,0.0,23.0,23.0" for k in range(300)]
    _, (only,) = read_open_recording(write_open(tmp_path / "bench", body=body, bench=bench, steps=[]))
    assert only.info.samples == 300


@st.composite
def recordings(draw: st.DrawFn) -> tuple[list[str], list[int]]:
    """Rows as text, and the decimals of the five columns."""
    decimals = draw(st.lists(st.integers(0, 7), min_size=4, max_size=4))
    count = draw(st.integers(1, 30))
    limits = [(0.0, 360.0), (-10.0, 10.0), (-60.0, 90.0), (-1e4, 1e4)]
    columns = [draw(st.lists(st.floats(low, high), min_size=count, max_size=count)) for low, high in limits]
    body = [
        ",".join([f"{k / 10:.6f}", *(f"{column[k]:.{d}f}" for column, d in zip(columns, decimals, strict=True))])
        for k in range(count)
    ]
    return body, [6, *decimals]


@settings(max_examples=60, deadline=None)
@given(recordings())
def test_samples_and_their_digits_survive(
    tmp_path_factory: pytest.TempPathFactory, recording: tuple[list[str], list[int]]
) -> None:
    body, decimals = recording
    folder = write_open(tmp_path_factory.mktemp("open"), body=body, steps=[])
    meta, (step,) = read_open_recording(folder)
    names = HEADER.split(",")
    assert meta.extra["csv_decimals"] == dict(zip(names, decimals, strict=True))
    printed = [
        ",".join(f"{step[name][k]:.{meta.extra['csv_decimals'][name]}f}" for name in names) for k in range(len(body))
    ]
    assert printed == body


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1e17, 1e17), min_size=1, max_size=8), st.sampled_from([".3f", "g", "r", ".17g", "e"]))
def test_decimals_are_promised_only_where_they_hold(values: list[float], style: str) -> None:
    cells = [repr(value) if style == "r" else f"{value:{style}}" for value in values]
    body = ("\n".join(cells) + "\n").encode()
    found = printed_decimals(body_of(Path("x.csv"), body, Layout(first_line=1)), ["x"])
    if "x" in found:
        assert [f"{float(cell):.{found['x']}f}" for cell in cells] == cells


def test_a_gzip_of_several_members_is_one_file(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "bench")
    text = gzip.decompress((folder / "samples.csv.gz").read_bytes())
    (folder / "samples.csv.gz").write_bytes(gzip.compress(text[:300]) + gzip.compress(text[300:]))
    assert sum(step.info.samples for step in read_open_recording(folder)[1]) == 40
