"""The gyro's chain keeps what predictions share: none may be answered with another's."""

from __future__ import annotations

import itertools
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.gyro.chain import GyroChain, Law
from benchctl.diagnosis.gyro.frame import Frame, frame_of
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.registry import effects
from tests.benchctl.diagnosis.moving import K0, U0, write_moving

FloatArray = npt.NDArray[np.float64]

LAW = Law(T0_c=20.0, temperature_terms=1, rate_terms=1)
EARTH_DPS = 0.003
BASELINES = tuple(
    np.array([K0 * scale, U0 + more, 1e-4, -1e-6]) for scale, more in ((1.0, 0.0), (1.01, 0.0), (1.0, 0.1))
)
CIRCUMSTANCES = {"T0_c": 20.0, "range_dps": 100.0}
NAMES = (
    "timing_offset",
    "encoder_eccentricity",
    "encoder_interpolation",
    "mount_resonance",
    "dead_zone",
    "thermal_lag",
    "thermal_hysteresis",
    "scale_asymmetry",
    "rate_squared",
    "warm_up",
    "sensor_bandwidth",
    "saturation",
    "adc_nonlinearity",
)


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Frame:
    with open_recording(write_moving(tmp_path_factory.mktemp("moving") / "r.h5", rate_hz=100.0)) as recording:
        return frame_of(recording)


def made(name: str) -> PhysicalEffect:
    """An effect with the values at which a search begins."""
    kind = effects()[name]
    return kind.make({each: parameter.scan[0] for each, parameter in kind.parameters.items()}, CIRCUMSTANCES)


def asked() -> list[tuple[FloatArray, tuple[PhysicalEffect, ...]]]:
    """Models with every effect alone and with its neighbours, at several values of the baseline, in a chance order."""
    alone = [(made(name),) for name in NAMES]
    pairs = [(made(one), made(other)) for one, other in itertools.pairwise(NAMES)]
    lagging = [(made(one), made("thermal_lag")) for one in NAMES[: NAMES.index("dead_zone")]]
    all_of_them = [(baseline, some) for some in ((), *alone, *pairs, *lagging) for baseline in BASELINES]
    order = np.random.default_rng(3).permutation(len(all_of_them))
    return [all_of_them[place] for place in order.tolist()]


def fresh(frame: Frame, baseline: FloatArray, some: tuple[PhysicalEffect, ...]) -> FloatArray:
    return GyroChain(frame, LAW, EARTH_DPS).predict(baseline, some)


def test_a_prediction_does_not_depend_on_what_was_asked_before(frame: Frame) -> None:
    chain = GyroChain(frame, LAW, EARTH_DPS)
    for baseline, some in asked():
        np.testing.assert_array_equal(chain.predict(baseline, some), fresh(frame, baseline, some), err_msg=f"{some}")


def test_nor_on_who_else_is_asking(frame: Frame) -> None:
    chain = GyroChain(frame, LAW, EARTH_DPS)
    with ThreadPoolExecutor(4) as pool:
        predicted = list(pool.map(lambda one: chain.predict(*one), asked()))
    for (baseline, some), volts in zip(asked(), predicted, strict=True):
        np.testing.assert_array_equal(volts, fresh(frame, baseline, some), err_msg=f"{some}")


@pytest.mark.parametrize("effects_of", [(), ("rate_squared",), ("sensor_bandwidth",)])
def test_a_prediction_cannot_be_spoilt_for_the_next_who_asks(effects_of: tuple[str, ...], frame: Frame) -> None:
    chain = GyroChain(frame, LAW, EARTH_DPS)
    volts = chain.predict(BASELINES[0], [made(name) for name in effects_of])
    with pytest.raises(ValueError, match="read-only"):
        volts += 1.0


def test_what_was_kept_is_let_go_of_and_made_again(frame: Frame) -> None:
    chain = GyroChain(frame, LAW, EARTH_DPS)
    some = (made("sensor_bandwidth"), made("thermal_lag"))
    volts = chain.predict(BASELINES[0], some)
    held, expected = weakref.ref(volts.base), volts.copy()
    del volts
    assert held() is not None
    chain.forget()
    assert held() is None
    np.testing.assert_array_equal(chain.predict(BASELINES[0], some), expected)
