from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.physics.chain import GRID_STAGES, STAGES, Signals, Stage, gyro_baseline, run_chain
from benchctl_instruments.physics.gyro import GyroParameters, bias_v, sine_output_v

INTERVAL = 5e-4
GYRO = GyroParameters()
BASELINE = gyro_baseline(GYRO, 0.0036, INTERVAL)
N = 3000


def made(first: int, count: int, interval_s: float = INTERVAL) -> Signals:
    """A sine of 150 deg/s at 2 Hz in a coil that warms up."""
    times = np.arange(first, first + count, dtype=np.float64) * interval_s
    omega = 4.0 * np.pi
    angle = -150.0 / omega * np.cos(omega * times)
    coil = 20.0 + 5.0 * times
    rate = 150.0 * np.sin(omega * times)
    return Signals(
        first_index=first,
        interval_s=interval_s,
        time_s=times,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=150.0 * omega * np.cos(omega * times),
        housing_c=coil,
        coil_c=coil,
        sensed_rate_dps=rate,
        output_v=np.zeros(count),
        encoder_deg=angle,
        thermistor_c=coil,
        coil_rate_c_per_s=np.full(count, 5.0),
    )


@dataclass(frozen=True)
class Toy:
    stage: Stage
    change: Callable[[Signals], Signals]

    def apply(self, signals: Signals) -> Signals:
        return self.change(signals)


def output(*effects: Toy) -> npt.NDArray[np.float64]:
    return run_chain(made(0, N), BASELINE, effects).output_v


def test_the_baseline_is_the_open_loop_gyro_behind_its_low_pass() -> None:
    slow = replace(made(0, N), rate_dps=np.full(N, 100.0), coil_c=np.full(N, 60.0))
    expected = sine_output_v(GYRO, np.array([100.0036]), np.array([60.0])) + bias_v(GYRO, np.array([60.0]))
    np.testing.assert_allclose(run_chain(slow, BASELINE).output_v, expected[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("effect", "size"),
    [
        (Toy("motion", lambda s: replace(s, rate_dps=s.rate_dps * 1.01)), 0.0586),
        (Toy("sensed_rate", lambda s: replace(s, sensed_rate_dps=s.sensed_rate_dps + 1.0)), 0.05),
        (Toy("coil_temperature", lambda s: replace(s, coil_c=s.coil_c + 10.0)), 0.0073),
        (Toy("scale", lambda s: replace(s, output_v=s.output_v * 1.02)), 0.139),
        (Toy("bias", lambda s: replace(s, output_v=s.output_v + 0.3)), 0.3),
        (Toy("electronics", lambda s: replace(s, output_v=np.clip(s.output_v, -6.0, 6.0))), 0.96),
        (Toy("sampling", lambda s: replace(s, output_v=s.output_v + 0.25)), 0.25),
    ],
    ids=lambda value: value.stage if isinstance(value, Toy) else "",
)
def test_an_effect_plugs_in_at_every_stage(effect: Toy, size: float) -> None:
    change = np.abs(output(effect) - output()).max()
    assert change == pytest.approx(size, rel=0.05)


def test_every_stage_takes_effects_in_the_order_of_the_chain() -> None:
    seen: list[str] = []

    def noting(stage: Stage) -> Toy:
        def note(signals: Signals) -> Signals:
            seen.append(stage)
            return signals

        return Toy(stage, note)

    run_chain(made(0, 10), BASELINE, [noting(stage) for stage in reversed(STAGES)])
    assert seen == ["motion", "sensed_rate", "coil_temperature", "scale", "bias", "electronics", "sampling"]


def test_effects_of_the_last_stage_do_not_run_on_the_grid() -> None:
    late = Toy("sampling", lambda s: replace(s, output_v=s.output_v * 0.0))
    assert np.abs(run_chain(made(0, N), BASELINE, [late], GRID_STAGES).output_v).max() > 1.0


def running_mean(signals: Signals) -> Signals:
    """An effect with a memory of its own: the sum of all outputs so far."""
    so_far = signals.memory.get("toy", np.zeros(1))[0]
    summed = so_far + np.cumsum(signals.output_v)
    return replace(signals, output_v=summed, memory={**signals.memory, "toy": summed[-1:]})


@given(cuts=st.lists(st.integers(1, N - 1), max_size=6, unique=True))
@settings(max_examples=40, deadline=None)
def test_a_run_in_chunks_is_the_run_in_one_piece(cuts: list[int]) -> None:
    effects = [Toy("bias", running_mean)]
    bounds = [0, *sorted(cuts), N]
    memory: dict[str, npt.NDArray[np.float64]] = {}
    parts = []
    for low, high in itertools.pairwise(bounds):
        done = run_chain(replace(made(low, high - low), memory=memory), BASELINE, effects)
        memory = dict(done.memory)
        parts.append(done.output_v)
    whole = run_chain(made(0, N), BASELINE, effects).output_v
    np.testing.assert_allclose(np.concatenate(parts), whole, rtol=1e-12, atol=1e-12)


def test_after_a_gap_the_electronics_start_from_what_they_see() -> None:
    first = run_chain(made(0, 100), BASELINE)
    later = run_chain(replace(made(1000, 100), memory=first.memory), BASELINE)
    fresh = run_chain(made(1000, 100), BASELINE)
    np.testing.assert_array_equal(later.output_v, fresh.output_v)


def test_sixteen_times_the_internal_rate_gives_the_same_volts() -> None:
    fine = run_chain(made(0, 16 * N, INTERVAL / 16), gyro_baseline(GYRO, 0.0036, INTERVAL / 16)).output_v[::16]
    # (ΔT)²/12 of the curvature, the peak of which is 6.6 V·(4π)²
    np.testing.assert_allclose(output()[200:], fine[200:], atol=1.1 * INTERVAL**2 / 12 * 7.5 * (4 * np.pi) ** 2)
