import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.diagnosis.result import COORDINATES, Estimate
from tests.benchctl.diagnosis.example import nothing_missing, pair, unknown_structure

_PRINT = "import json; from tests.benchctl.diagnosis.example import pair; print(json.dumps(pair().as_json()))"


def written(diagnosis):
    """As a program reads it: strict JSON, there and back."""
    return json.loads(json.dumps(diagnosis.as_json(), allow_nan=False))


@pytest.mark.parametrize("diagnosis", [pair(), nothing_missing(), unknown_structure()], ids=lambda one: one.recording)
def test_every_key_of_the_contract_is_there_with_its_type(diagnosis):
    told = written(diagnosis)
    assert told["schema"] == "benchctl-diagnosis/2"
    assert told["verdict"] in {"consistent", "recalibrate", "missing-physics", "unknown-structure"}
    assert set(told["software"]) == {"benchctl"}
    for parameter in told["baseline"]["parameters"].values():
        assert len(parameter["ci95"]) == 2
    for finding in told["findings"]:
        assert 0 <= finding["probability"] <= 1
        assert set(finding["where"]["coordinate"].split("*")) <= set(COORDINATES)
        assert set(finding["where"]) == {"coordinate", "ranges", "steps", "share_of_excess"}
        assert finding["says"]
        for parameter in finding["parameters"].values():
            assert set(parameter) == {"value", "ci95", "unit"}
    assert isinstance(told["unexplained"]["significant"], bool)
    assert told["part"] == "gyro"
    assert told["fit"].pop("unit") == "V"
    assert set(told["fit"]) == {"noise", "before", "after", "heldout_before", "heldout_named", "heldout_after"}
    assert all(isinstance(value, float) for value in told["fit"].values())
    assert set(told["next_experiment"]) >= {"says", "procedure", "separates"}


def test_the_numbers_are_those_of_the_diagnosis():
    told = written(pair())
    lag, eccentricity = told["findings"]
    assert lag["effect"] == "thermal_lag"
    assert lag["parameters"]["tau_s"] == {"value": 590.8, "ci95": [575.1, 606.5], "unit": "s"}
    assert lag["where"]["ranges"] == [[0.021, 0.058]]
    assert lag["alternatives"] == [{"effect": "thermal_hysteresis", "probability": 0.01, "loss": 9.2}]
    assert (lag["gain"], lag["gain_heldout"]) == (4321.5, 811.2)
    assert eccentricity["parameters"]["phase_deg"]["value"] == 331.5
    assert told["baseline"]["parameters"]["K0_v_per_dps"]["was"] == 0.016
    assert "was" not in told["baseline"]["parameters"]["delay_s"]
    assert told["not_found"][1] == {
        "effect": "scale_warm_up",
        "parameter": "fraction",
        "would_show_from": {"value": 2.1e-5, "unit": "1"},
        "injected": True,
        "others": {"tau_s": 600.0},
    }
    assert sum(step["heldout"] for step in told["steps"]) == 12
    assert told["seed"] == 0


def test_what_is_not_finite_is_null():
    endless = Estimate(value=math.inf, low=800.0, high=math.inf, unit="Hz")
    told = written(replace(pair(), baseline={"cutoff_hz": endless}))
    assert told["baseline"]["parameters"]["cutoff_hz"] == {"value": None, "ci95": [800.0, None], "unit": "Hz"}


def test_numbers_of_numpy_become_plain():
    estimate = Estimate(value=np.float64(2.0), low=np.float64(1.0), high=np.float64(3.0), unit="V")
    odd = replace(
        pair(),
        baseline={"U0_v": estimate},
        seed=np.int64(3),
        unexplained=replace(pair().unexplained, significant=np.bool_(True)),
        next_experiment=replace(pair().next_experiment, parameters={"rates": (np.float64(1.5), 2), "slow": True}),
    )
    told = written(odd)
    assert told["unexplained"]["significant"] is True
    assert told["next_experiment"]["parameters"] == {"rates": [1.5, 2], "slow": True}
    assert told["seed"] == 3


def test_the_last_bits_of_a_sum_do_not_show():
    one = pair()
    figures = {name: getattr(one.fit, name) * (1 + 1e-9) for name in ("noise", "before", "after")}
    K0 = one.baseline["K0_v_per_dps"]
    moved = replace(K0, value=K0.value * (1 + 1e-12), low=K0.low * (1 - 1e-12), high=K0.high * (1 + 1e-12))
    other = replace(one, fit=replace(one.fit, **figures), baseline={**one.baseline, "K0_v_per_dps": moved})
    assert written(other) == written(one)


@given(
    value=st.floats(1e-9, 1e9),
    relative_width=st.floats(1e-9, 1.0),
)
def test_rounding_moves_an_estimate_by_less_than_a_hundredth_of_its_interval(value, relative_width):
    width = value * relative_width
    estimate = Estimate(value=value, low=value - width / 2, high=value + width / 2, unit="V")
    told = written(replace(pair(), baseline={"x": estimate}))["baseline"]["parameters"]["x"]
    assert abs(told["value"] - value) <= 0.01 * width
    assert abs(told["ci95"][0] - estimate.low) <= 0.01 * width
    assert abs(told["ci95"][1] - estimate.high) <= 0.01 * width


@pytest.mark.slow
def test_two_processes_write_the_same_text():
    texts = [
        subprocess.run([sys.executable, "-c", _PRINT], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    assert texts[0] == texts[1]
    assert json.loads(texts[0]) == written(pair())
