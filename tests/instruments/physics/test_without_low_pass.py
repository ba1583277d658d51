"""A gyro whose output has no low-pass answers at once."""

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import Signals, gyro_baseline, run_chain
from benchctl_instruments.physics.gyro import GyroParameters, bias_v, sine_output_v


def test_of_order_0_the_output_is_that_of_the_rate_at_the_instant() -> None:
    time_s = np.arange(0.0, 1.0, 1e-3)
    rate = 100.0 * np.sin(2 * np.pi * 9.0 * time_s)
    still, warm = np.zeros_like(rate), np.full_like(rate, 30.0)
    signals = Signals(
        interval_s=1e-3, time_s=time_s, angle_deg=still, rate_dps=rate, acceleration_dps2=still, housing_c=warm,
        coil_c=warm, sensed_rate_dps=rate, output_v=still, encoder_deg=still, thermistor_c=warm,
        coil_rate_c_per_s=still,
    )  # fmt: skip
    gyro = GyroParameters(order=0)
    output = run_chain(signals, gyro_baseline(gyro, 0.0, 1e-3)).output_v
    np.testing.assert_allclose(output, sine_output_v(gyro, rate, warm) + bias_v(gyro, warm), rtol=0, atol=1e-12)
    late = run_chain(signals, gyro_baseline(GyroParameters(order=1, cutoff_hz=50.0), 0.0, 1e-3)).output_v
    assert np.max(np.abs(late - output)) > 0.1


def test_another_order_is_refused() -> None:
    with pytest.raises(UsageError, match=r"a low-pass of order 3 at 200\.0 Hz; give order 0 to 2"):
        GyroParameters(order=3)
