from __future__ import annotations

import math
from typing import Any

import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.adc_coarse import AdcCoarse
from benchctl_instruments.physics.effects.bias_temperature import BiasTemperature
from benchctl_instruments.physics.effects.encoder_eccentricity import EncoderEccentricity
from benchctl_instruments.physics.effects.making import LATE, make_effects
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth


def test_effects_are_made_from_tables_in_the_bench_s_circumstances() -> None:
    made = make_effects(
        {
            "adc_coarse": {"bits_lost": 2},
            "sensor_bandwidth": {"cutoff_hz": 20.0},
            "bias_temperature": {"c1_v_per_c": 1e-4, "c2_v_per_c2": 0.0},
        },
        {"T0_c": 25.0, "adc_step_v": 1e-3, "nobody": 1.0},
    )
    assert made == (
        BiasTemperature(c1_v_per_c=1e-4, c2_v_per_c2=0.0, T0_c=25.0),
        SensorBandwidth(cutoff_hz=20.0, order=2.0),
        AdcCoarse(bits_lost=2, adc_step_v=1e-3),
    )


def test_a_table_may_state_a_circumstance_of_its_own() -> None:
    made = make_effects({"bias_drift": {"v_per_hour": 1e-3, "start_s": 60.0}}, {"start_s": 0.0})
    assert made[0].apply.__self__.start_s == 60.0  # type: ignore[attr-defined]


def test_what_comes_late_in_a_stage_is_known_and_comes_in_the_order_of_the_parts() -> None:
    assert set(LATE) <= set(effects())
    tables: dict[str, dict[str, float]] = {
        "dropouts": {"count": 1, "hold_s": 1.0},
        "adc_coarse": {"bits_lost": 1},
        "flicker_noise": {"v_rms_per_decade": 1e-3},
        "outliers": {"fraction": 0.1, "scale_v": 1.0},
        "adc_nonlinearity": {"inl_v": 1e-3, "period_v": 1.0},
    }
    order = [made.identifier for made in make_effects(tables)]
    assert order == ["flicker_noise", "adc_nonlinearity", "adc_coarse", "outliers", "dropouts"]


def test_an_effect_that_is_gone_may_be_stated() -> None:
    assert make_effects({"sensor_bandwidth": {"cutoff_hz": math.inf}})[0].values["cutoff_hz"] == math.inf


def test_further_effects_of_a_kind_are_numbered() -> None:
    first = {"amplitude_arcsec": 15.0, "phase_deg": 40.0}
    second = {"amplitude_arcsec": 5.0, "phase_deg": 110.0, "order": 2.0}
    tenth = {"amplitude_arcsec": 1.0, "phase_deg": 0.0, "order": 4.0}
    tables = {"encoder_eccentricity": first, "encoder_eccentricity_2": second, "encoder_eccentricity_10": tenth}
    assert make_effects(tables) == tuple(EncoderEccentricity(**one) for one in (first, second, tenth))


@pytest.mark.parametrize("name", ["_1", "_0", "_02", "_2_2", "_two", "_", "2", "_-2", "_\N{SUPERSCRIPT TWO}"])
def test_what_is_no_number_from_two_on_names_no_further_effect(name: str) -> None:
    table = {"amplitude_arcsec": 5.0, "phase_deg": 110.0}
    with pytest.raises(
        UsageError,
        match=rf"^\[effects\.encoder_eccentricity{name}\] effect 'encoder_eccentricity{name}': there is no such effect",
    ):
        make_effects({f"encoder_eccentricity{name}": table})


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        (
            {"thermal_lag_2": {"tau_s": 1.0}},
            r"^\[effects\.thermal_lag_2\] effect 'thermal_lag_2': there is no such effect; there are ",
        ),
        (
            {"encoder_eccentricity_2": {"phase_deg": 1.0}},
            r"^\[effects\.encoder_eccentricity_2\] amplitude_arcsec: this field is needed and is not there",
        ),
        (
            {"thermal_lagg": {"tau_s": 1.0}},
            r"^\[effects\.thermal_lagg\] effect 'thermal_lagg': there is no such effect; there are ",
        ),
        ({"thermal_lag": 312.0}, r"^\[effects\.thermal_lag\] expected a table of its parameters, got 312\.0"),
        ({"thermal_lag": {"tau": 1.0}}, r"^\[effects\.thermal_lag\] tau: no such field; there are tau_s$"),
        ({"warm_up": {"tau_s": 9.0}}, r"^\[effects\.warm_up\] amplitude_v: this field is needed and is not there"),
        ({"thermal_lag": {"tau_s": -1.0}}, r"^\[effects\.thermal_lag\] tau_s: expected .* \(s\), got -1"),
        ({"thermal_lag": {"tau_s": math.inf}}, r"\[effects\.thermal_lag\] tau_s: expected .* got inf"),
        ({"thermal_lag": {"tau_s": math.nan}}, r"\[effects\.thermal_lag\] tau_s: expected a number, got nan"),
        ({"thermal_lag": {"tau_s": "long"}}, r"\[effects\.thermal_lag\] tau_s: expected a number, got 'long'"),
        ({"thermal_lag": {"tau_s": True}}, r"\[effects\.thermal_lag\] tau_s: expected a number, got True"),
        ({"sensor_bandwidth": {"cutoff_hz": 9.0, "order": 1.5}}, r"order: expected an integer, got 1\.5"),
        (
            {"bias_drift": {"v_per_hour": 0.1, "start_s": math.inf}},
            r"\[effects\.bias_drift\] start_s: expected a finite number, got inf",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_table_and_field(tables: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        make_effects(tables)
