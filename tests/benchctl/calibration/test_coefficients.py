"""`coefficients.json`: its letter, its way back, and what it compensates."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.calibration.coefficients import coefficients, compensate, read_coefficients, write_coefficients
from benchctl.calibration.uncertainty import coverage_factor
from benchctl_instruments.errors import UsageError
from tests.benchctl.calibration.campaigns import TRUTH, calibrated
from tests.benchctl.calibration.synthetic import gyro


@pytest.fixture
def content() -> dict[str, Any]:
    return coefficients(calibrated(), [("recording.h5", "sha256:12")])


def test_every_key_of_the_specification_is_there(content: dict[str, Any]) -> None:
    assert content["schema"] == "benchctl-coefficients/1"
    assert (content["convention"], content["argument"]) == ("correction", "indicated")
    assert content["T0_c"] == 20.0
    assert content["K0_v_per_dps"] == content["stages"][-1]["K0_v_per_dps"]
    assert len(content["stages"]) == 2
    for stage, (n_t, n_omega) in zip(content["stages"], [(2, 2), (1, 1)], strict=True):
        assert {"k_T", "k_omega", "K0_v_per_dps", "U0_v", "delay_s", "error_percent"} <= set(stage)
        assert np.shape(stage["k_T"]["covariance"]) == (n_t, n_t)
        assert np.shape(stage["k_omega"]["covariance"]) == (n_omega, n_omega)
        assert stage["error_percent"]["before"] > stage["error_percent"]["after"]
    assert content["valid"]["rate_dps"] == pytest.approx([-160, 160], abs=0.5)
    assert content["valid"]["temperature_c"] == pytest.approx([-40, 60], abs=0.01)
    assert content["uncertainty"]["k"] == 2
    assert content["source"] == [{"recording": "recording.h5", "digest": "sha256:12"}]
    assert {"raw", "stage_1", "stage_2", "joint"} <= set(content["error_percent"]) == set(content["rms_percent"])
    assert content["joint"]["law"] == "sine"
    size = len(content["joint"]["parameters"])
    assert np.shape(content["joint"]["covariance"]["matrix"]) == (size, size)


def test_the_budget_adds_up_to_the_expanded_uncertainty(content: dict[str, Any]) -> None:
    for parameter in content["uncertainty"]["parameters"].values():
        combined = np.sqrt(sum(part["standard"] ** 2 for part in parameter["budget"]))
        assert parameter["expanded"] == pytest.approx(parameter["k"] * combined)
    sources = [part["source"] for part in content["uncertainty"]["parameters"]["K0_v_per_dps"]["budget"]]
    assert sources == ["type A", "encoder", "time base", "ADC gain", "thermometer"]


def test_the_expanded_uncertainty_is_never_narrower_than_the_scatter_at_the_same_level(content: dict[str, Any]) -> None:
    for name, parameter in content["uncertainty"]["parameters"].items():
        type_a = parameter["budget"][0]
        assert type_a["kind"] == "A"
        assert parameter["expanded"] >= coverage_factor(type_a["dof"] or math.inf) * type_a["standard"] * 0.999, name
        assert parameter["expanded"] >= 0.5 * (parameter["ci95"][1] - parameter["ci95"][0]), name
        assert parameter["k"] >= coverage_factor(parameter["dof"] or math.inf) * 0.999, name


def test_few_degrees_of_freedom_demand_more_than_k_2(content: dict[str, Any]) -> None:
    found = content["uncertainty"]["parameters"]
    assert content["uncertainty"]["level"] == pytest.approx(0.9545, abs=1e-4)
    assert found["encoder_cos1_arcsec"]["dof"] < 100
    assert found["encoder_cos1_arcsec"]["k"] > 2.02
    assert found["K0_v_per_dps"]["k"] == pytest.approx(2.0, abs=0.01), "the bench's certificates prevail"


def test_what_is_written_is_read_back(content: dict[str, Any], tmp_path: Path) -> None:
    write_coefficients(tmp_path / "coefficients.json", content)
    assert read_coefficients(tmp_path / "coefficients.json") == content
    assert [path.name for path in tmp_path.iterdir()] == ["coefficients.json"]


@pytest.mark.parametrize(("by", "percent"), [("stages", 0.3), ("joint", 0.01)])
def test_compensation_gives_the_true_rate_back(content: dict[str, Any], by: Any, percent: float) -> None:
    rate, temperature = np.meshgrid(np.linspace(-155, 155, 63), np.linspace(-40, 60, 11))
    volts = gyro(TRUTH, rate.ravel() + TRUTH.earth, temperature.ravel())
    found = compensate(volts, temperature.ravel(), content, by=by, earth_rate="remove")
    assert np.max(np.abs(found - rate.ravel())) / 155 * 100 < percent


def test_a_response_is_inverted() -> None:
    stage = {"k_T": {"coefficients": [1e-4]}, "k_omega": {"coefficients": [-3e-6]}}
    content = {
        "schema": "benchctl-coefficients/1",
        "convention": "response",
        "argument": "true",
        "K0_v_per_dps": 0.02,
        "U0_v": 0.1,
        "T0_c": 20.0,
        "stages": [stage],
    }
    rate = np.array([-120.0, 5.0, 80.0])
    volts = 0.1 + 0.02 * (1 + 1e-4 * 10) * (1 - 3e-6 * rate**2) * rate
    assert compensate(volts, np.full(3, 30.0), content) == pytest.approx(rate)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "not JSON"),
        ("[" * 100_000, "nested too deep"),
        ("[]", "found 'list'"),
        ('{"schema": "other/1"}', "found 'other/1'"),
        ('{"schema": "benchctl-coefficients/1"}', "'convention' is missing"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "coefficients.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=says) as caught:
        read_coefficients(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_coefficients(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"convention": "guess"}, "not known"),
        ({"argument": "true"}, "cannot be applied"),
        ({"stages": []}, "`stages` is empty"),
    ],
)
def test_a_convention_that_makes_no_sense_is_refused(
    content: dict[str, Any], change: dict[str, Any], says: str, tmp_path: Path
) -> None:
    path = tmp_path / "coefficients.json"
    path.write_text(json.dumps({**content, **change}))
    with pytest.raises(UsageError, match=says):
        read_coefficients(path)


def test_coefficients_that_cannot_be_written_leave_nothing(content: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        write_coefficients(tmp_path / "nowhere" / "coefficients.json", content)
