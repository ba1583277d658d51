from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.settings import WorldSettings


def test_what_is_not_named_keeps_its_default() -> None:
    settings = WorldSettings.from_mapping({"room_c": 21, "gyro": {"K0_v_per_dps": 0.06}, "encoder": {"sign": -1}})
    default = WorldSettings()
    expected = replace(
        default,
        room_c=21.0,
        gyro=replace(default.gyro, K0_v_per_dps=0.06),
        encoder=replace(default.encoder, sign=-1),
    )
    assert settings == expected
    assert isinstance(settings.room_c, float)


def test_a_response_may_stand_in_place_of_the_gyro() -> None:
    lab = {"K0_v_per_dps": 0.02, "U0_v": 0, "T0_c": 20.0, "k_T": [1e-4], "k_omega": [], "noise_v_rms": 1e-4}
    settings = WorldSettings.from_mapping({"response": {**lab, "output_limit_v": 5}})
    assert settings.response is not None
    assert (settings.response.k_T, settings.response.k_omega, settings.response.U0_v) == ((1e-4,), (), 0.0)
    assert WorldSettings().response is None


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"rom_c": 20.0}, r"^\[simulated\] rom_c: no such field; there are gyro, table, .*room_c"),
        ({"gyro": {"K1": 1.0}}, r"^\[simulated\.gyro\] K1: no such field; there are K0_v_per_dps"),
        ({"gyro": 3}, r"^\[simulated\] gyro: expected a table \[simulated\.gyro\], got 3"),
        ({"room_c": "warm"}, r"^\[simulated\] room_c: expected a finite number, got 'warm'"),
        ({"room_c": float("nan")}, r"expected a finite number, got nan"),
        ({"seed": 1.5}, r"^\[simulated\] seed: expected an integer, got 1.5"),
        ({"seed": True}, r"^\[simulated\] seed: expected an integer, got True"),
        ({"grid_hz": 500}, "at least four times the gyro's cutoff_hz"),
        ({"latitude_deg": 91}, "latitude_deg is 91"),
        ({"seed": -1}, "seed is -1; give an integer, 0 or more"),
        ({"response": {"K0_v_per_dps": 1.0}}, r"^\[simulated\.response\] U0_v: this field is needed and is not there"),
        ({"response": {"k_T": 1.0}}, r"^\[simulated\.response\] k_T: expected a list of numbers, got 1\.0"),
        ({"response": {"k_T": [1e-4, "b"]}}, r"^\[simulated\.response\] k_T: expected a finite number, got 'b'"),
        ({"response": 7}, r"^\[simulated\] response: expected a table \[simulated\.response\], got 7"),
        ({"gyro": {"cutoff_hz": 0.05}}, "the gyro's cutoff_hz is 0.05: the simulated bench needs 0.2 or more"),
    ],
)
def test_a_wrong_field_is_named(mapping: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        WorldSettings.from_mapping(mapping)


def test_another_bench_has_other_noise_and_another_encoder_and_the_same_gyro() -> None:
    nominal = WorldSettings()
    one, other = nominal.drawn(1), nominal.drawn(2)
    assert one == nominal.drawn(1)
    assert one.seed != other.seed
    assert one.encoder.eccentricity_phase_deg != other.encoder.eccentricity_phase_deg
    assert one.encoder.eccentricity_arcsec == nominal.encoder.eccentricity_arcsec
    assert (one.gyro, one.table, one.chamber) == (nominal.gyro, nominal.table, nominal.chamber)
