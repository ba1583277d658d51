"""The C header: what a compiler makes of it is what Python has, and no file's text breaks out of it."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.calibration.c_header import c_header, export_c_header, in_comment, number, polynomial, string
from benchctl.calibration.coefficients import coefficients, write_coefficients
from benchctl.calibration.compensating import Compensation, read_compensation, self_test_points
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.campaigns import calibrated
from tests.benchctl.calibration.made_coefficients import (
    RATE_DPS,
    TEMPERATURE_C,
    FloatArray,
    asked,
    compiled,
    contents,
    joint_of,
    program_with,
    stage,
    written,
)

POINTS = 4000


def _points(compensation: Compensation, seed: int, wider: float = 1.2) -> tuple[FloatArray, FloatArray]:
    """Outputs and temperatures over the valid range and somewhat beyond."""
    chance = np.random.default_rng(seed)
    (slowest, fastest), (coldest, warmest) = compensation.valid.rate_dps, compensation.valid.temperature_c
    if not np.isfinite(coldest):
        coldest, warmest = TEMPERATURE_C
    rate_dps = wider * chance.uniform(slowest, fastest, POINTS)
    celsius = chance.uniform(coldest - 5.0, warmest + 5.0, POINTS)
    return compensation.law.volts(rate_dps, celsius) + chance.normal(0.0, 1e-3, POINTS), celsius


def _agree(compensation: Compensation, program: Path, seed: int = 1) -> None:
    volts, celsius = _points(compensation, seed)
    answer = asked(program, volts, celsius)
    assert (answer.missed, answer.unit) == (0, compensation.unit)
    expected = compensation.law.rate_dps(volts, celsius)
    assert np.isfinite(expected).mean() > 0.5
    np.testing.assert_allclose(answer.rate_dps, expected, rtol=1e-12, atol=1e-12 * RATE_DPS)
    # On the border itself a last digit may decide.
    clear = np.abs(np.abs(expected) - RATE_DPS) > 1e-9
    assert np.array_equal(answer.valid[clear], compensation.valid.inside(expected, celsius)[clear])


@pytest.mark.parametrize("language", ["c", "c++"])
def test_the_header_of_a_fit_compiles_without_a_warning_and_agrees_with_python(language: str, tmp_path: Path) -> None:
    content = coefficients(calibrated(), [("recording.h5", "12" * 32)])
    write_coefficients(tmp_path / "coefficients.json", content)
    compensation, program = compiled(tmp_path / "coefficients.json", tmp_path, language)
    assert (compensation.law.name, compensation.by) == ("sine", "joint")
    volts, celsius = _points(compensation, 1, wider=1.0)
    answer = asked(program, volts, celsius)
    assert (answer.missed, answer.unit) == (0, content["unit"])
    expected = compensation.law.rate_dps(volts, celsius)
    np.testing.assert_allclose(answer.rate_dps, expected, rtol=1e-12, atol=1e-12 * RATE_DPS)
    assert np.array_equal(answer.valid, compensation.valid.inside(answer.rate_dps, celsius))
    assert 0.5 < answer.valid.mean() < 1.0


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"joint": None},
        {"joint": joint_of("polynomial", {"K0_v_per_dps": 0.05, "U0_v": 0.1, "b2": 3e-6, "b4": 6e-11, "a1": 1e-4})},
        {"joint": joint_of("response", {"K0_v_per_dps": -0.05, "U0_v": 0.1, "b2": -3.4e-6, "b4": 3e-12, "c1": 1e-3})},
        {"joint": joint_of("polynomial", {"K0_v_per_dps": 0.05, "U0_v": 0.1})},
        {"joint": joint_of("response", {"K0_v_per_dps": 0.05, "U0_v": 0.1, "a1": 1e-3})},
        {
            "joint": None,
            "convention": "response",
            "argument": "true",
            "T0_c": None,
            "stages": [stage([], [-3e-6, 3e-12])],
            "valid": {"rate_dps": [-150.0, 150.0], "temperature_c": [None, None]},
        },
    ],
    ids=["sine", "stages", "polynomial", "response", "line", "line over temperature", "static points"],
)
def test_every_law_agrees_with_python(changes: dict[str, Any], tmp_path: Path) -> None:
    compensation, program = compiled(written(tmp_path, **changes), tmp_path)
    _agree(compensation, program)


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(content=contents(), seed=st.integers(0, 1000))
def test_any_coefficients_agree_with_python(content: dict[str, Any], seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "coefficients.json"
        path.write_text(json.dumps(content))
        compensation, program = compiled(path, Path(folder))
        _agree(compensation, program, seed)


@pytest.mark.parametrize(
    "hostile",
    ["*/ int evil(void); /*", "a\n#error e\n", '"; #error e', "??/\n", "\\", "\\\n", "СГ-1 ‮х", "x" * 100_000, "%d %s"],
)  # fmt: skip
def test_no_text_of_a_file_breaks_out(hostile: str, tmp_path: Path) -> None:
    path = written(tmp_path, unit=hostile, source=[{"recording": hostile, "digest": hostile}])
    compensation, program = compiled(path, tmp_path)
    answer = asked(program, np.zeros(1), np.zeros(1))
    assert answer.missed == 0
    assert answer.unit == hostile or answer.unit == f"{hostile[:197]}..."
    assert (tmp_path / "gyro_compensation.h").read_bytes().isascii()
    text = c_header(compensation)
    assert max(map(len, text.splitlines())) < 4095
    assert text.count("*/") == text.count("/*")


@given(st.text())
def test_a_string_literal_says_the_bytes_of_its_text(text: str) -> None:
    literal = string(text[:200])
    assert literal.isascii()
    assert literal.isprintable()
    body = literal[1:-1]
    assert '"' not in body.replace("\\042", "")
    octal = body.encode().decode("unicode_escape").encode("latin-1")
    assert octal.decode("utf-8") == text[:200]


@given(st.text())
def test_a_comment_cannot_be_ended_or_begun_by_a_text(text: str) -> None:
    said = in_comment(text)
    assert said.isascii()
    assert not any(mark in said for mark in ("*/", "/*", "??", "\n", "\r"))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_a_double_that_gives_the_same_double_back(value: float) -> None:
    text = number(value)
    assert float(text.strip("()")) == value
    assert any(mark in text for mark in ".e")


def test_a_polynomial_is_written_by_horners_rule() -> None:
    assert polynomial(("A", "B", "C"), "z") == "(A + (B + C * z) * z) * z"


def test_the_same_coefficients_give_the_same_bytes(tmp_path: Path) -> None:
    path = written(tmp_path)
    for name in ("one.h", "two.h"):
        export_c_header(read_compensation(path), tmp_path / name)
    assert (tmp_path / "one.h").read_bytes() == (tmp_path / "two.h").read_bytes()
    assert str(tmp_path) not in (tmp_path / "one.h").read_text()


def test_the_header_says_whose_it_is_where_it_is_valid_and_how_sure(tmp_path: Path) -> None:
    compensation = read_compensation(written(tmp_path))
    lines = c_header(compensation).splitlines()
    assert '#define GYRO_UNIT_SERIAL "VG-7"' in lines
    assert f'#define GYRO_SOURCE_1_DIGEST "{"ab" * 32}"' in lines
    assert f'#define GYRO_COEFFICIENTS_SHA256 "{compensation.sha256}"' in lines
    defined = {words[1]: words[2] for line in lines if len(words := line.split()) > 2 and words[0] == "#define"}
    assert float(defined["GYRO_K0_V_PER_DPS"].strip("()")) == 0.05
    assert float(defined["GYRO_K0_V_PER_DPS_EXPANDED"].strip("()")) == pytest.approx(5e-5)
    assert float(defined["GYRO_K_T2_PER_C2_EXPANDED"].strip("()")) == pytest.approx(2e-9)
    assert float(defined["GYRO_VALID_RATE_MAX_DPS"].strip("()")) == RATE_DPS
    assert float(defined["GYRO_VALID_TEMPERATURE_MIN_C"].strip("()")) == -40.0
    assert float(defined["GYRO_DELAY_S"].strip("()")) == 1.125e-3
    assert not any("encoder" in line for line in lines)


def test_the_self_test_covers_the_valid_range_with_its_corners(tmp_path: Path) -> None:
    points = self_test_points(read_compensation(written(tmp_path)))
    assert len(points) >= 24
    for rate_dps in (-RATE_DPS, RATE_DPS):
        for celsius in TEMPERATURE_C:
            assert any(
                point.celsius == celsius and point.rate_dps == pytest.approx(rate_dps, abs=1e-9) for point in points
            )


def test_a_wrong_constant_fails_the_self_test(tmp_path: Path) -> None:
    path = written(tmp_path)
    _, program = compiled(path, tmp_path)
    assert asked(program, np.zeros(1), np.zeros(1)).missed == 0
    header = tmp_path / "gyro_compensation.h"
    spoilt = header.read_text().replace("GYRO_S_RAD_PER_DPS (0.0044999999999999997)", "GYRO_S_RAD_PER_DPS (0.0045001)")
    assert spoilt != header.read_text()
    header.write_text(spoilt)
    assert asked(program_with(tmp_path), np.zeros(1), np.zeros(1)).missed > 20


def test_the_header_of_a_digital_gyro_takes_the_rate_that_it_states(tmp_path: Path) -> None:
    joint = joint_of("sine", {"K0_v_per_dps": 0.998, "S_rad_per_dps": 0.0045, "g1": -1.3e-4, "U0_v": 0.01, "c1": 4e-4})
    compensation, program = compiled(written(tmp_path, output_unit="deg/s", joint=joint), tmp_path)
    _agree(compensation, program)
    text = (tmp_path / "gyro_compensation.h").read_text()
    assert {"GYRO_K0_DPS_PER_DPS", "GYRO_U0_DPS", "GYRO_U0_T1_DPS_PER_C1"} <= set(text.split())
    assert "double gyro_rate_dps(double stated_dps, double celsius)" in text
    assert "volts" not in text


def test_an_output_that_is_neither_volts_nor_a_rate_gets_no_header(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="an output in deg/h, expected V or deg/s for a C header"):
        export_c_header(read_compensation(written(tmp_path, output_unit="deg/h")), tmp_path / "g.h")
    assert not (tmp_path / "g.h").exists()


def test_a_law_that_ends_inside_its_valid_range_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, valid={"rate_dps": [-400.0, 400.0], "temperature_c": [-40.0, 60.0]})
    with pytest.raises(UsageError, match="the law has no output for -400 deg/s at -40 °C"):
        export_c_header(read_compensation(path), tmp_path / "g.h")
    assert not (tmp_path / "g.h").exists()
