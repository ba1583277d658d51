"""Coefficients read for use: what they must hold, and what is said where they do not."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.calibration.compensating import FORMULAS, compensation_json, export_json, read_compensation
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.made_coefficients import joint_of, made, stage, written

PLAIN = {"K0_v_per_dps": 0.05, "U0_v": 0.1, "S_rad_per_dps": 0.0045}


def test_the_joint_fit_is_taken_where_there_is_one(tmp_path: Path) -> None:
    path = written(tmp_path)
    joint, stages = read_compensation(path), read_compensation(path, "stages")
    assert (joint.by, joint.law.name, joint.law.delay_s, joint.error_percent) == ("joint", "sine", 1.125e-3, 0.01)
    assert (stages.by, stages.law.name, stages.law.delay_s, stages.error_percent) == ("stages", "polynomial", 1e-3, 0.7)
    assert joint.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read_compensation(written(tmp_path, joint=None)).by == "stages"


def test_uncertainties_are_those_of_the_laws_own_parameters(tmp_path: Path) -> None:
    path = written(tmp_path)
    assert set(read_compensation(path).expanded) == {
        "K0_v_per_dps", "S_rad_per_dps", "g1", "g2", "U0_v", "c1", "c2", "delay_s"
    }  # fmt: skip
    assert read_compensation(path, "stages").expanded == {}


def test_rates_and_temperatures_are_held_against_what_was_measured(tmp_path: Path) -> None:
    compensation = read_compensation(written(tmp_path))
    rate_dps = np.array([-150.0, 150.0, 150.001, 0.0, 0.0, np.nan])
    celsius = np.array([-40.0, 60.0, 20.0, 60.001, np.nan, 20.0])
    assert compensation.valid.inside(rate_dps, celsius).tolist() == [True, True, False, False, False, False]


def test_a_temperature_that_nobody_wrote_down_bounds_nothing(tmp_path: Path) -> None:
    alone = {"joint": None, "T0_c": None, "stages": [stage([], [1e-6])]}
    valid = {"rate_dps": [-1.0, 1.0], "temperature_c": [None, None]}
    compensation = read_compensation(written(tmp_path, **alone, valid=valid))
    assert compensation.valid.temperature_c == (-math.inf, math.inf)
    assert compensation_json(compensation)["T0_c"] is None
    assert compensation_json(compensation)["valid"]["temperature_c"] == [None, None]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"schema": "other/1"}, "found 'other/1'"),
        ({"K0_v_per_dps": "0.05"}, "K0_v_per_dps: expected a number, got '0.05'"),
        ({"K0_v_per_dps": 0.0, "joint": None}, "is 0, which gives no rate"),
        ({"joint": joint_of("sine", PLAIN | {"S_rad_per_dps": 0.0})}, "is 0, which gives no rate"),
        ({"joint": joint_of("sine", {"K0_v_per_dps": 1.0, "U0_v": 1.0})}, "law sine, has no S_rad_per_dps"),
        ({"joint": joint_of("guess", PLAIN)}, "joint.law"),
        ({"joint": joint_of("response", PLAIN | {"b3": 1.0})}, "has the terms b3, which are no polynomial's"),
        ({"joint": joint_of("response", PLAIN | {"a99": 1.0})}, "has the terms a99, which are no polynomial's"),
        ({"stages": [{"k_T": 1}]}, "stages[0].k_T"),
        ({"stages": [stage([0.0] * 100, [])]}, "stages[0].k_T.coefficients"),
        (
            {"stages": [stage([], [])] * 2, "joint": None, "convention": "response", "argument": "true"},
            "no one inverse",
        ),
        ({"T0_c": None}, "T0_c is null, though the law depends on the temperature"),
        ({"valid": None}, "does not say where it is valid"),
        ({"valid": {"rate_dps": [1.0, -1.0], "temperature_c": [0.0, 1.0]}}, "expected the lower end first"),
        ({"valid": {"rate_dps": [-1.0], "temperature_c": [0.0, 1.0]}}, "valid.rate_dps"),
        ({"source": ["a"]}, "source[0]"),
        ({"unit": 7}, "unit: expected text"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line_with_the_file(
    changes: dict[str, Any], says: str, tmp_path: Path
) -> None:
    path = written(tmp_path, **changes)
    with pytest.raises(UsageError) as caught:
        read_compensation(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_what_is_no_number_is_no_coefficient(text: str, tmp_path: Path) -> None:
    path = tmp_path / "coefficients.json"
    path.write_text(json.dumps(made()).replace('"K0_v_per_dps": 0.0498', f'"K0_v_per_dps": {text}'))
    with pytest.raises(UsageError, match="K0_v_per_dps: expected a finite number"):
        read_compensation(path)


def test_a_law_that_is_not_there_is_not_taken(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="hold no joint fit"):
        read_compensation(written(tmp_path, joint=None), "joint")


@pytest.mark.parametrize("by", ["joint", "stages"])
def test_json_holds_all_that_its_formula_needs(by: Any, tmp_path: Path) -> None:
    compensation = read_compensation(written(tmp_path), by)
    export_json(compensation, tmp_path / "c.json")
    content = json.loads((tmp_path / "c.json").read_text())
    assert content["schema"] == "benchctl-compensation/1"
    assert content["formula"] == FORMULAS[content["law"]]
    assert (content["unit"], content["source"][0]["digest"]) == ("VG-7", "ab" * 32)
    assert len(content["self_test"]["points"]) >= 24
    for volts, celsius, rate_dps in content["self_test"]["points"]:
        assert _by_formula(content, volts, celsius) == pytest.approx(
            rate_dps, abs=content["self_test"]["tolerance_dps"]
        )


def test_json_of_a_response_is_solved_by_its_own_rate(tmp_path: Path) -> None:
    joint = joint_of("response", {"K0_v_per_dps": 0.05, "U0_v": 0.1, "b2": -3e-6, "a1": 1e-4})
    content = compensation_json(read_compensation(written(tmp_path, joint=joint)))
    only = content["stages"][0]
    for volts, celsius, rate_dps in content["self_test"]["points"]:
        target = _indicated(content, volts, celsius) / _factor(only["k_T"], celsius - content["T0_c"])
        assert rate_dps * _factor(only["k_omega"], rate_dps**2) == pytest.approx(target, abs=1e-9)


def test_json_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    compensation = read_compensation(written(tmp_path))
    with pytest.raises(UsageError, match="cannot be written"):
        export_json(compensation, tmp_path / "nowhere" / "c.json")
    assert [path.name for path in tmp_path.iterdir()] == ["coefficients.json"]


def _factor(coefficients: list[float], argument: float) -> float:
    return 1.0 + sum(c * argument ** (i + 1) for i, c in enumerate(coefficients))


def _indicated(content: dict[str, Any], volts: float, celsius: float) -> float:
    dt = celsius - content["T0_c"]
    bias = sum(c * dt ** (i + 1) for i, c in enumerate(content["U0_T"]))
    return float((volts - content["U0_v"] - bias) / content["K0_v_per_dps"])


def _by_formula(content: dict[str, Any], volts: float, celsius: float) -> float:
    """The formula in plain Python, as a stranger would write it."""
    rate, dt, S = _indicated(content, volts, celsius), celsius - content["T0_c"], content["S_rad_per_dps"]
    if content["law"] == "sine":
        return math.asin(S * rate / _factor(content["stages"][0]["k_T"], dt)) / S
    for each in content["stages"]:
        rate = rate * _factor(each["k_T"], dt) * _factor(each["k_omega"], rate**2)
    return rate
