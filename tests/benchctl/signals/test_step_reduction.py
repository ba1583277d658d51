"""A step that is reduced part by part gives what it gives in one piece, wherever the parts end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.recordings import stored
from benchctl.recordings.model import Step
from benchctl.signals.reduce import ReducedStep, reduce_step
from tests.benchctl.calibration.campaigns import TRUTH, calibrated, recorded
from tests.benchctl.calibration.synthetic import Ask, meta_of, steps

META = meta_of(TRUTH)
ASKS = {
    "static": Ask(kind="static", temperature=20, seconds=20),
    "constant rate": Ask(kind="constant_rate", temperature=20, rate=-120, seconds=21),
    "a turn in several parts": Ask(kind="constant_rate", temperature=20, rate=45, seconds=21),
    "slow rate": Ask(kind="constant_rate", temperature=20, rate=4, seconds=20),
    "sine": Ask(kind="sine", temperature=20, rate=150, frequency=1, seconds=20),
}


def made(ask: Ask) -> Step:
    return next(steps(TRUTH, [ask], seed=5))


def reduced(step: Step, monkeypatch: pytest.MonkeyPatch, scans_at_once: int = 1 << 19) -> ReducedStep:
    with monkeypatch.context() as patch:
        patch.setattr(stored, "SCANS_AT_ONCE", scans_at_once)
        found = reduce_step(step, META)
    assert found is not None
    return found


def mean(step: ReducedStep, name: str) -> float:
    return float(np.average(getattr(step, name), weights=step.count))


@pytest.mark.parametrize("name", ASKS)
@pytest.mark.parametrize("scans_at_once", [2048, 3001, 9000])
def test_in_parts_the_same_samples_are_averaged(name: str, scans_at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    step = made(ASKS[name])
    whole, parts = reduced(step, monkeypatch), reduced(step, monkeypatch, scans_at_once)
    assert parts.samples == whole.samples
    assert parts.smoother == whole.smoother
    assert (parts.masked, parts.unsettled) == (whole.masked, whole.unsettled)
    assert parts.revolutions == pytest.approx(whole.revolutions, rel=1e-3)
    for column in ("time_s", "output_v", "rate_at_stamp_dps"):
        assert mean(parts, column) == pytest.approx(mean(whole, column), abs=1e-9, rel=1e-9), column
    assert parts.delay_s == pytest.approx(whole.delay_s, abs=2e-5)  # by the first samples, however many there are
    assert mean(parts, "temperature_c") == pytest.approx(mean(whole, "temperature_c"), abs=1e-9)
    edges = np.cumsum(parts.count)
    interval = 1.0 / TRUTH.fs
    assert np.diff(parts.time_s) == pytest.approx(0.5 * (parts.count[1:] + parts.count[:-1]) * interval, abs=1e-9)
    assert edges[-1] == parts.samples


@pytest.mark.parametrize("at", [2047, 2048, 2049, 2030, 4100])
def test_a_gap_near_the_end_of_a_part_stays_a_gap(at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    step = made(ASKS["sine"])
    keep = np.r_[0:at, at + 300 : step["time_s"].size]
    cut = Step(step.info, {name: values[keep] for name, values in step.channels.items()})
    whole, parts = reduced(cut, monkeypatch), reduced(cut, monkeypatch, 2048)
    inside = (parts.time_s > step["time_s"][at - 1]) & (parts.time_s < step["time_s"][at + 300])
    assert not inside.any()
    assert abs(parts.samples - whole.samples) <= 32
    phase = 2 * np.pi * (parts.time_s - step["time_s"][0] - parts.delay_s)
    assert parts.rate_dps == pytest.approx(150 * np.sin(phase), abs=1.5)


def test_clipped_and_missing_samples_are_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    step = made(ASKS["sine"])
    volts, angle = step["gyro_v"].copy(), step["encoder_deg"].copy()
    volts[2020:2070], angle[4090:4096], volts[7000] = 10.0, np.nan, np.inf
    spoilt = Step(step.info, {**step.channels, "gyro_v": volts, "encoder_deg": angle})
    whole, parts = reduced(spoilt, monkeypatch), reduced(spoilt, monkeypatch, 2048)
    assert whole.masked == parts.masked == 57
    assert parts.output_v.max() < 8


def test_a_spin_up_is_looked_for_once_and_a_later_disturbance_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    step = made(Ask(kind="constant_rate", temperature=20, rate=50, seconds=40))
    t = np.arange(step["time_s"].size) / TRUTH.fs
    angle = np.where(t < 2, 12.5 * t**2, 50 * t - 50) + np.where(np.abs(t - 25) < 0.2, 0.3 * np.sin(40 * t), 0.0)
    spun = Step(step.info, {**step.channels, "encoder_deg": np.floor(angle * 1000) / 1000 % 360})
    parts = reduced(spun, monkeypatch, 6000)
    assert parts.unsettled / TRUTH.fs == pytest.approx(2.1, abs=0.15)
    disturbed = np.abs(parts.time_s - step["time_s"][0] - 25) < 0.2
    assert disturbed.any()
    assert np.all(np.abs(parts.rate_dps[np.abs(parts.time_s - step["time_s"][0] - 25) > 1]) - 50 < 0.05)


def test_a_table_that_settles_in_no_part_gives_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    step = made(Ask(kind="constant_rate", temperature=20, rate=50, seconds=20))
    t = np.arange(step["time_s"].size) / TRUTH.fs
    monkeypatch.setattr(stored, "SCANS_AT_ONCE", 2048)
    assert reduce_step(Step(step.info, {**step.channels, "encoder_deg": (5 * t**2) % 360}), META) is None


def test_free_motion_is_cut_into_pieces_whatever_the_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    step = made(Ask(kind="sine", temperature=20, rate=150, frequency=0.2, seconds=60))
    free = Step(replace(step.info, kind="motion", frequency_hz=None, amplitude_dps=None), step.channels)
    whole, parts = reduced(free, monkeypatch), reduced(free, monkeypatch, 7000)
    assert parts.samples == whole.samples
    assert mean(parts, "output_v") == pytest.approx(mean(whole, "output_v"), abs=1e-5)
    assert mean(parts, "rate_dps") == pytest.approx(mean(whole, "rate_dps"), abs=1e-5)


def test_a_campaign_whose_steps_are_taken_in_parts_has_the_same_coefficients(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = calibrated()
    monkeypatch.setattr(stored, "SCANS_AT_ONCE", 6000)
    parts = calibrate(recorded(), META)
    for parameter in whole.best.parameters:
        other = parts.best.parameter(parameter.name)
        assert abs(other.value - parameter.value) < 0.2 * parameter.standard, parameter.name
        assert other.standard == pytest.approx(parameter.standard, rel=0.05), parameter.name
    assert parts.error_percent["joint"] == pytest.approx(whole.error_percent["joint"], rel=0.01)
