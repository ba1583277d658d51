from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.physics.adc import codes_from_volts, volts_from_codes


@pytest.mark.parametrize(
    ("volts", "code"),
    [
        (0.0, 0x8000),
        (-10.0, 0x0000),
        (9.99969482421875, 0xFFFF),
        (0.00030517578125, 0x8001),
        (-5.0, 0x4000),
        (0.00015, 0x8000),
        (0.00016, 0x8001),
    ],
)
def test_sixteen_bits_over_ten_volts_give_the_codes_of_the_formula(volts: float, code: int) -> None:
    assert codes_from_volts(np.array([volts]), range_v=10.0)[0] == code


def test_volts_beyond_the_range_are_clipped_to_the_extreme_codes_of_their_side() -> None:
    codes = codes_from_volts(np.array([-1e9, -10.001, 10.0, 11.0, np.inf, -np.inf]), range_v=10.0)
    assert codes.tolist() == [0, 0, 0xFFFF, 0xFFFF, 0xFFFF, 0]


@given(st.integers(0, 0xFFFF), st.sampled_from([10.0, 1.0, 0.1, 0.01]))
def test_every_code_stands_for_volts_that_give_it_back(code: int, range_v: float) -> None:
    volts = volts_from_codes(np.array([code]), range_v=range_v)
    assert codes_from_volts(volts, range_v=range_v)[0] == code


@given(st.floats(-10.0, 9.9998), st.sampled_from([8, 16, 24]))
def test_a_voltage_within_the_range_comes_back_within_half_a_step(volts: float, bits: int) -> None:
    back = volts_from_codes(codes_from_volts(np.array([volts]), range_v=10.0, bits=bits), range_v=10.0, bits=bits)
    step_v = 20.0 / 2**bits
    assert abs(back[0] - volts) <= step_v / 2 + 1e-12 or volts > 10.0 - 1.5 * step_v


def test_the_error_over_many_steps_is_uniform() -> None:
    volts = np.random.default_rng(7).uniform(-9.0, 9.0, 200_000)
    error = volts_from_codes(codes_from_volts(volts, range_v=10.0), range_v=10.0) - volts
    step_v = 20.0 / 65536
    assert np.std(error) == pytest.approx(step_v / np.sqrt(12.0), rel=0.01)
    assert abs(np.mean(error)) < 3.0 * step_v / np.sqrt(12.0 * volts.size)
