"""Numbers of the two filters that textbooks give."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.signal

from benchctl_instruments.physics.effect_contract.behaviour import sampled
from benchctl_instruments.physics.effects.mount_resonance import MountResonance
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth


@pytest.mark.parametrize("order", [1, 2])
def test_the_bandwidth_is_butterworths(order: int) -> None:
    frequencies = np.array([0.1, 5.0, 22.0, 60.0, 400.0])
    _, expected = scipy.signal.freqs(
        *scipy.signal.butter(order, 2.0 * np.pi * 22.0, analog=True), 2.0 * np.pi * frequencies
    )
    gain = SensorBandwidth(cutoff_hz=22.0, order=order).response(frequencies)
    np.testing.assert_allclose(gain, expected, rtol=1e-12)
    assert abs(gain[2]) == pytest.approx(math.sqrt(0.5))


@pytest.mark.parametrize(
    ("order", "delay_s"), [(1, 1.0 / (2.0 * math.pi * 56.0)), (2, math.sqrt(2.0) / (2.0 * math.pi * 56.0))]
)
def test_slow_motion_is_delayed_by_the_bandwidth(order: float, delay_s: float) -> None:
    gain = SensorBandwidth(cutoff_hz=56.0, order=order).response(np.array([0.5]))[0]
    assert -np.angle(gain) / (2.0 * math.pi * 0.5) == pytest.approx(delay_s, rel=1e-4)
    assert abs(gain) == pytest.approx(1.0, abs=1e-4)
    assert f"{1e3 * delay_s:.2g} ms late" in SensorBandwidth(cutoff_hz=56.0, order=order).says()


@pytest.mark.parametrize("damping", [0.05, 0.14, 0.7])
def test_a_mount_amplifies_as_its_transmissibility_says(damping: float) -> None:
    mount = MountResonance(frequency_hz=96.0, damping=damping)
    at_resonance, crossing = np.abs(mount.response(np.array([96.0, 96.0 * math.sqrt(2.0)])))
    assert at_resonance == pytest.approx(math.sqrt(1.0 + 4.0 * damping**2) / (2.0 * damping))
    assert crossing == pytest.approx(1.0)  # every damping's curve passes through one at √2·ωₙ


def test_no_bandwidth_and_no_mount_change_nothing() -> None:
    signals = sampled()
    assert SensorBandwidth(cutoff_hz=math.inf).apply(signals) is signals
    assert MountResonance(frequency_hz=math.inf, damping=0.1).apply(signals) is signals


def test_a_mount_whose_damping_the_data_do_not_determine_keeps_a_plausible_one() -> None:
    bound = MountResonance.parameters["damping"].high
    assert MountResonance(frequency_hz=20.0, damping=0.3).assuming(()) is None
    assert MountResonance(frequency_hz=2000.0, damping=bound).assuming(["frequency_hz", "damping"]) is None
    mount = MountResonance(frequency_hz=20.0, damping=bound).assuming(["damping"])
    assert mount is not None
    assert mount.values == {"frequency_hz": 20.0, "damping": 0.4}
    assert mount.parameters["damping"].role == "assumed"
    assert "assumed, not measured" in mount.says()
    assert mount.response(np.array([7.0])) == MountResonance(frequency_hz=20.0, damping=0.4).response(np.array([7.0]))
