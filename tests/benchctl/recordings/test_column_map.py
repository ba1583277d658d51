"""Map files: the examples parse, and each fault names the file, the line and the field."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchctl.recordings.column_map import parse_map, read_map
from benchctl.recordings.map_examples import MAP_EXAMPLES, example
from benchctl_instruments.errors import UsageError

MAP_EXAMPLE_CSV = example("samples")
MAP_EXAMPLE_MAT = example("mat")
MAP_EXAMPLE_POINTS = example("points")

MAPS = Path(__file__).parent / "maps"


@pytest.mark.parametrize("title", MAP_EXAMPLES)
def test_the_examples_of_the_help_are_maps(title: str) -> None:
    mapping = parse_map(MAP_EXAMPLES[title], title)
    assert mapping.unit is not None


@pytest.mark.parametrize("path", sorted(MAPS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_maps_of_the_tests_are_maps(path: Path) -> None:
    mapping, text = read_map(path)
    assert mapping.channels is not None
    assert text == path.read_text(encoding="utf-8")


def test_the_examples_need_no_heavy_import() -> None:
    code = "import benchctl.recordings.map_examples, sys; print({'numpy', 'pydantic'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("table", "raw", "expected"),
    [
        ('encoder_deg]\nunit = "counts"\ncounts_per_rev = 4096', 1024.0, 90.0),
        ('encoder_deg]\nunit = "rad"\nsign = -1', math.pi, -180.0),
        ('encoder_deg]\nunit = "arcsec"\noffset = 5', 3600.0, 6.0),
        ('gyro_v]\nunit = "mV"\nscale = 10', 5.0, 0.05),
        ('gyro_v]\nunit = "rad/s"', math.pi, 180.0),
        ('gyro_v]\nunit = "deg/h"\nsign = -1', 3600.0, -1.0),
        ('gyro_temp_c]\nunit = "K"', 300.0, 26.85),
        ('gyro_temp_c]\nunit = "degF"', 212.0, 100.0),
        ('torque_nm]\nunit = "N m"\nscale = 2\noffset = 1', 3.0, 7.0),
        ('torque_nm]\nunit = "N·m"', 3.0, 3.0),
        ('table_rate_dps]\nunit = "rpm"', 2.0, 12.0),
    ],
)
def test_units_signs_scales_and_offsets_are_applied_in_this_order(table: str, raw: float, expected: float) -> None:
    mapping = parse_map(f"[time]\nrate_hz = 1\n[channels.{table}\ncolumn = 1\n", "map.toml")
    assert mapping.channels is not None
    (entry,) = mapping.channels.columns.values()
    assert entry.conversion.apply(np.array([raw])) == pytest.approx([expected])


FAULTS = {
    "a unit that is not known": (
        MAP_EXAMPLE_CSV.replace('"mV" ', '"furlong" '),
        "line 30: channels.gyro_v.unit: the unit 'furlong' is not known here; known are V, mV",
    ),
    "a unit of another quantity": (
        MAP_EXAMPLE_CSV.replace('"K" ', '"V" '),
        "line 36: channels.gyro_temp_c.unit: the unit 'V' is not known here; known are degC, °C, K, degF",
    ),
    "a unit of time that is none": (
        MAP_EXAMPLE_MAT.replace('unit = "s"', 'unit = "V"'),
        "line 12: time.unit: the unit",
    ),
    "an unknown unit of points": (MAP_EXAMPLE_POINTS.replace('"deg/s"', '"deg"'), "points.rate.unit: the unit 'deg'"),
    "counts of what": (
        MAP_EXAMPLE_CSV.replace("counts_per_rev = 65536\nsign", "sign"),
        "channels.encoder_deg: an angle in counts needs counts_per_rev",
    ),
    "a misspelt field": (
        MAP_EXAMPLE_CSV.replace("header_line", "headerline"),
        "line 13: file.headerline: there is no such",
    ),
    "a sign of two": (
        MAP_EXAMPLE_CSV.replace("sign = -1", "sign = 2"),
        "channels.encoder_deg.sign: expected 1 or",
    ),
    "an unknown kind": (MAP_EXAMPLE_CSV.replace('"sine" ', '"spin" '), "kind: expected 'static'"),
    "a step with a misspelt field": (MAP_EXAMPLE_CSV.replace("t_end", "tend"), "tend: there is no such field"),
    "two marks that are one": (
        MAP_EXAMPLE_CSV.replace('delimiter = ";"', 'delimiter = ","'),
        "cannot be the delimiter",
    ),
    "a reserved name": (MAP_EXAMPLE_CSV.replace("supply_v", "poll_x"), "a channel cannot be named 'poll_x'"),
    "no channels": ("[time]\nrate_hz = 1\n[channels]\n", "channels: name at least one channel"),
    "no time": ('[channels.gyro_v]\ncolumn = 1\nunit = "V"\n', r"say [time] and [channels.…]"),
    "two times": ("[time]\nrate_hz = 1\ncolumn = 1\n", "time: say either column"),
    "points and samples": (MAP_EXAMPLE_POINTS + "[time]\nrate_hz = 1\n", "[points] excludes other tables"),
    "an unknown policy": (
        MAP_EXAMPLE_MAT.replace('"repair"', '"guess"'),
        "time.stamps: expected 'refuse', 'repair'",
    ),
    "no TOML": ("[unit\n", "not TOML"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_names_the_file_the_line_and_the_field(tmp_path: Path, fault: str) -> None:
    text, says = FAULTS[fault]
    path = tmp_path / "map.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError) as caught:
        read_map(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert says in message
    assert "\n" not in message


def test_a_map_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nowhere"):
        read_map(tmp_path / "nowhere.toml")
