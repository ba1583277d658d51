"""Bandwidth and delay: a first-order low-pass of known cutoff behind a known dead time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.metrology.gyro_tests.response import _first_below
from benchctl.plan import Mount, Static
from tests.benchctl.metrology.altered import nan_in, results, without
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, sines, soak, sweep

NAMES = ("bandwidth", "delay")
AROUND_HZ = (0.5, 1.0, 1.5, 1.9, 2.1, 2.5, 4.0)
FAST = replace(IDEAL, white_v_per_sqrt_hz=1e-9)


def test_the_band_ends_where_the_gain_is_three_decibels_down() -> None:
    found = results([soak(), *sweep(), *sines(AROUND_HZ)], replace(FAST, cutoff_hz=2.0, delay_s=0.0))
    assert found["bandwidth"].value == pytest.approx(2.0, rel=1e-3)
    assert found["bandwidth"].bound == ""


def test_or_where_the_phase_is_a_right_angle_late_whichever_comes_first() -> None:
    """A dead time of 100 ms behind 5 Hz: atan(f/5) + 2π·f·0.1 s is a right angle at 2.0 Hz."""
    unit = replace(FAST, cutoff_hz=5.0, delay_s=0.1)
    found = results([soak(), *sweep(), *sines(AROUND_HZ)], unit)["bandwidth"]
    frequency = np.linspace(1.5, 2.5, 100_001)
    late = np.arctan(frequency / 5.0) + 2.0 * np.pi * frequency * 0.1
    assert found.value == pytest.approx(frequency[np.searchsorted(late, np.pi / 2)], rel=1e-3)


def test_the_delay_is_the_slope_of_the_phase_at_low_frequencies() -> None:
    unit = replace(FAST, cutoff_hz=1000.0, delay_s=0.004)
    found = results([soak(), *sweep(), *sines((0.5, 1.0, 2.0))], unit)["delay"]
    assert found.value == pytest.approx(1e3 * (0.004 + 1.0 / (2.0 * np.pi * 1000.0)), rel=1e-5)


def test_a_band_beyond_the_swings_is_at_least_the_fastest() -> None:
    found = results([soak(), *sweep(), *sines((0.5, 1.0, 2.0))], replace(IDEAL, cutoff_hz=100.0))["bandwidth"]
    assert (found.value, found.bound) == (2.0, "at least")
    assert found.uncertainty is not None
    assert found.uncertainty.says.key == "as_tried"


def test_a_gyro_that_is_not_straight_is_none_that_falls_off() -> None:
    """At 90 deg/s the output is a tenth short at any frequency: that is no bandwidth."""
    unit = replace(FAST, cubic_per_dps2=1.5e-5, cutoff_hz=1000.0, delay_s=0.0)
    found = results([soak(), *sweep(), *sines((0.5, 1.0, 2.0), amplitude_dps=90.0)], unit)["bandwidth"]
    gains = next(column for column in found.table if column.name == "gain").values
    assert gains == pytest.approx([1.0, 1.0, 1.0], abs=2e-4)


def test_swings_of_one_frequency_are_averaged() -> None:
    unit = replace(FAST, cutoff_hz=2.0)
    once = results([soak(), *sweep(), *sines(AROUND_HZ)], unit)
    twice = results([soak(), *sweep(), *sines(AROUND_HZ), *sines(AROUND_HZ)], unit)
    for name in NAMES:
        assert twice[name].value == pytest.approx(once[name].value, rel=1e-5)
    frequencies = next(column for column in twice["delay"].table if column.name == "frequency").values
    assert frequencies == AROUND_HZ
    assert len(twice["delay"].steps) == 2 * len(AROUND_HZ)


def test_twice_as_many_swings_halve_the_variance_of_the_delay() -> None:
    unit = replace(IDEAL, white_v_per_sqrt_hz=1e-3)
    once = results([soak(), *sweep(), *sines(AROUND_HZ)], unit)["delay"].uncertainty
    twice = results([soak(), *sweep(), *sines(AROUND_HZ), *sines(AROUND_HZ)], unit)["delay"].uncertainty
    assert once is not None
    assert twice is not None
    assert (once.standard / twice.standard) ** 2 == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize(
    ("steps", "why"),
    [
        ([soak(), *sweep()], "needs_sines"),
        ([soak(), *sweep(), *sines((0.5, 1.0))], "needs_sines"),
        ([soak(), *sweep(), *sines((0.5, 0.5, 1.0, 1.0))], "needs_sines"),
        ([soak(), *sweep(), *sines((0.5, 1.0, 2.0), amplitude_dps=0.5)], "needs_sines"),  # they hardly move
        ([soak(), *sweep(), *sines((0.5, 1.0, 24.0))], "needs_sines"),  # above what the sampling shows
        ([soak(), *sweep(), soak(60.0), *sines((0.5, 1.0, 2.0))], "needs_sines"),  # elsewhere
        ([soak(), *sweep(), Mount(position="across"), *sines((0.5, 1.0, 2.0))], "needs_sines"),
        ([soak(), Static(duration_s=60.0), *sines((0.5, 1.0, 2.0))], "needs_scale_factor"),
    ],
)
def test_what_is_lacking_is_said(steps: list, why: str) -> None:
    found = results(steps, QUIET)
    for name in NAMES:
        assert found[name].refused is not None
        assert found[name].refused.key == why  # type: ignore[union-attr]


@pytest.mark.parametrize("change", [nan_in("gyro_v", "sine"), without("encoder_deg", kind="sine")])
def test_swings_without_samples_are_none(change: object) -> None:
    found = results([soak(), *sweep(), *sines(AROUND_HZ)], QUIET, change=change)  # type: ignore[arg-type]
    for name in NAMES:
        assert found[name].refused is not None
        assert found[name].refused.values["found"] == 0  # type: ignore[union-attr]


def test_a_crossing_between_two_frequencies_is_found_on_a_smooth_curve() -> None:
    frequencies = np.geomspace(1.0, 16.0, 9)
    gains = 1.0 / np.sqrt(1.0 + (frequencies / 5.0) ** 2)
    many = np.stack([gains, 0.9 * gains, np.full(9, 1.0), np.full(9, 0.1)])
    found = _first_below(frequencies, many, 1.0 / np.sqrt(2.0))
    lower = 5.0 * np.sqrt(2.0 * 0.9**2 - 1.0)
    assert found == pytest.approx([5.0, lower, 16.0, 1.0], rel=2e-3)
