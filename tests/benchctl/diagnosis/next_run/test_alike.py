"""Look-alikes, computed: shares of a direction, and what parts two effects in a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.diagnosis.next_run.alike import ALIKE, imitated, separation
from benchctl.plan import ConstantRate, Sine, Static
from instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from instruments.physics.effects.warm_up import WarmUp
from tests.benchctl.diagnosis.following import LATE, SMOOTH, fitted, problem_of, whitener_of

FAST = (
    Static(duration_s=20.0),
    ConstantRate(rate_dps=60.0, duration_s=20.0),
    Sine(amplitude_dps=60.0, frequency_hz=0.5, cycles=20),
    Sine(amplitude_dps=15.0, frequency_hz=9.0, cycles=300),
)


@given(degrees=st.floats(0.0, 90.0), size=st.floats(1e-3, 1e3))
def test_the_share_is_the_squared_cosine_of_the_angle_between_two_directions(degrees: float, size: float) -> None:
    first, third = np.eye(50)[:, :1], np.eye(50)[:, 2:3]
    turned = np.cos(np.radians(degrees)) * first + np.sin(np.radians(degrees)) * np.eye(50)[:, 1:2]
    share = np.cos(np.radians(degrees)) ** 2
    assert imitated(first, size * turned, third) == pytest.approx(share, abs=1e-9)


def test_what_the_baseline_can_follow_is_no_part_of_the_share() -> None:
    chance = np.random.default_rng(0)
    shared, own, other = (chance.standard_normal((200, 1)) for _ in range(3))
    assert imitated(own + 50.0 * shared, other + 50.0 * shared, np.zeros((200, 1))) > 0.99
    assert imitated(own + 50.0 * shared, other + 50.0 * shared, shared) < 0.1
    assert imitated(own, np.hstack([other, own]), shared) == pytest.approx(1.0)


def test_a_delay_and_a_low_pass_are_alike_in_slow_motion_and_not_in_fast(tmp_path: Path) -> None:
    (tmp_path / "slow").mkdir()
    (tmp_path / "fast").mkdir()
    slow, fast = problem_of(tmp_path / "slow"), problem_of(tmp_path / "fast", LATE, *FAST)
    apart = []
    for problem in (slow, fast):
        model = fitted(problem, LATE)
        apart.append(separation(problem, whitener_of(problem), model, model.point.effects[0], SensorBandwidth))
    assert apart[0] < ALIKE < 2 * ALIKE < apart[1]


def test_an_effect_that_has_nothing_of_another_leaves_all_that_it_is_worth(tmp_path: Path) -> None:
    problem = problem_of(tmp_path)
    whitener, model = whitener_of(problem), fitted(problem, LATE)
    first = model.point.effects[0]
    whole = fitted(problem).squares / model.deviation**2 - model.squares / model.deviation**2
    assert separation(problem, whitener, model, first, WarmUp) == pytest.approx(whole, rel=0.05)
    assert separation(problem, whitener, model, first, first) == pytest.approx(0.0, abs=1e-6)
    assert separation(problem, whitener, model, first, SMOOTH) < ALIKE
