"""Random effects by their statistics, and that they do not depend on how a run is cut."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effect_contract.behaviour import sampled
from benchctl_instruments.physics.effects.bias_random_walk import BiasRandomWalk
from benchctl_instruments.physics.effects.draws import normals
from benchctl_instruments.physics.effects.dropouts import Dropouts
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.flicker_noise import FlickerNoise
from benchctl_instruments.physics.effects.noise_rate_dependent import NoiseRateDependent
from benchctl_instruments.physics.effects.outliers import Outliers

INTERVAL = 0.01


def at_rest(scans: int, *, first: int = 0, start_s: float = 0.0, interval_s: float = INTERVAL) -> Signals:
    """A stretch in which nothing happens."""
    zeros = np.zeros(scans)
    names = ("angle_deg", "rate_dps", "acceleration_dps2", "sensed_rate_dps", "output_v", "encoder_deg")
    return replace(
        sampled(),
        first_index=first,
        interval_s=interval_s,
        time_s=start_s + interval_s * np.arange(scans, dtype=np.float64),
        **dict.fromkeys(names, zeros),  # type: ignore[arg-type]  # every name is an array's
    )


def in_order(effect: PhysicalEffect, stretches: Sequence[Signals]) -> FloatArray:
    """The output of stretches one after the other."""
    memory = stretches[0].memory
    parts = []
    for stretch in stretches:
        done = effect.apply(replace(stretch, memory=memory))
        memory = done.memory
        parts.append(done.output_v)
    return np.concatenate(parts)


def cut(signals: Signals, bounds: Sequence[int]) -> list[Signals]:
    """A stretch as several."""
    return [
        replace(
            signals,
            first_index=signals.first_index + low,
            time_s=signals.time_s[low:high],
            rate_dps=signals.rate_dps[low:high],
            output_v=signals.output_v[low:high],
        )
        for low, high in itertools.pairwise(bounds)
    ]


EFFECTS: tuple[PhysicalEffect, ...] = (
    Outliers(fraction=0.05, scale_v=1.0),
    Dropouts(count=40.0, hold_s=0.3, span_scans=3000.0),
    NoiseRateDependent(factor_at_full_rate=3.0),
    BiasRandomWalk(v_per_sqrt_s=1.0),
    FlickerNoise(v_rms_per_decade=1.0),
)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.identifier)
@given(cuts=st.lists(st.integers(1, 1799), max_size=6, unique=True), first=st.integers(0, 900))
@settings(max_examples=20, deadline=None)
def test_a_stream_with_a_gap_does_not_depend_on_how_it_is_read(
    effect: PhysicalEffect, cuts: list[int], first: int
) -> None:
    rising = np.linspace(-100.0, 100.0, 900)
    streams = [
        replace(at_rest(900, first=first, start_s=40.0), output_v=rising, rate_dps=rising),
        replace(at_rest(900, first=first + 900, start_s=2000.0), output_v=rising, rate_dps=rising),
    ]
    whole = in_order(effect, streams)
    here = sorted(place for place in cuts if place < 900)
    there = sorted(place - 900 for place in cuts if place > 900)
    pieces = [*cut(streams[0], [0, *here, 900]), *cut(streams[1], [0, *there, 900])]
    np.testing.assert_allclose(in_order(effect, pieces), whole, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.identifier)
def test_another_seed_is_another_draw(effect: Outliers) -> None:
    stretch = replace(at_rest(3000), output_v=np.arange(3000.0), rate_dps=np.ones(3000))
    one, same, other = (replace(effect, seed=seed).apply(stretch).output_v for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.0


def test_draws_of_two_effects_with_one_seed_share_nothing() -> None:
    one, other = normals(7, "one", 0, 20_000, 1)[:, 0], normals(7, "other", 0, 20_000, 1)[:, 0]
    assert abs(np.corrcoef(one, other)[0, 1]) < 4.0 / math.sqrt(20_000)
    np.testing.assert_array_equal(normals(7, "one", 1234, 10, 2), normals(7, "one", 0, 2000, 2)[1234:1244])


def test_so_many_samples_are_hit_and_so_hard() -> None:
    scans, fraction = 400_000, 0.002
    volts = Outliers(fraction=fraction, scale_v=0.5).apply(at_rest(scans)).output_v
    hit = volts[volts != 0.0]
    assert hit.size == pytest.approx(scans * fraction, abs=5.0 * math.sqrt(scans * fraction))
    assert hit.std() == pytest.approx(0.5, rel=5.0 / math.sqrt(2.0 * hit.size))
    assert abs(hit.mean()) < 5.0 * 0.5 / math.sqrt(hit.size)


def test_the_output_stands_still_so_often_and_so_long() -> None:
    scans = 100_000
    busy = replace(at_rest(scans), output_v=np.arange(float(scans)))
    volts = Dropouts(count=7.0, hold_s=0.5, span_scans=scans).apply(busy).output_v
    begins = np.flatnonzero((np.diff(volts) == 0.0) & (np.diff(volts, prepend=-1.0)[:-1] != 0.0))
    assert begins.size == 7
    for begin in begins:
        assert (volts[begin : begin + 50] == begin).all()
        assert volts[begin + 50] == begin + 50


def test_a_hold_that_meets_a_new_stream_holds_what_that_begins_with() -> None:
    always = Dropouts(count=3000.0, hold_s=1e3, span_scans=3000.0)
    streams = [replace(at_rest(100, first=5000 + k, start_s=float(k)), output_v=k + np.arange(100.0)) for k in (0, 100)]
    np.testing.assert_array_equal(in_order(always, streams), np.repeat([0.0, 100.0], 100))


def test_noise_grows_with_the_rate_either_way() -> None:
    scans, sigma = 100_000, 5e-4
    made = NoiseRateDependent(factor_at_full_rate=3.0, range_dps=180.0, noise_v_rms=sigma)
    for rate, factor in ((0.0, 1.0), (90.0, math.sqrt(3.0)), (-180.0, 3.0)):
        bench = sigma * np.random.default_rng(5).standard_normal(scans)
        volts = made.apply(replace(at_rest(scans), rate_dps=np.full(scans, rate), output_v=bench)).output_v
        assert volts.std() == pytest.approx(factor * sigma, rel=5.0 / math.sqrt(2.0 * scans))


def test_the_bias_strays_with_the_root_of_the_time_through_gaps() -> None:
    strength, draws = 2e-3, 400
    ends = np.array(
        [
            in_order(
                BiasRandomWalk(v_per_sqrt_s=strength, seed=seed),
                [at_rest(3, start_s=100.0), at_rest(3, first=3, start_s=900.0)],
            )[[2, 3]]
            for seed in range(draws)
        ]
    )
    tolerance = 5.0 * math.sqrt(2.0 / draws)
    assert np.var(ends[:, 0]) == pytest.approx(strength**2 * 100.02, rel=tolerance)
    assert np.var(ends[:, 1] - ends[:, 0]) == pytest.approx(strength**2 * 799.98, rel=tolerance)


def test_a_walking_bias_is_in_a_late_reading_as_it_was_last() -> None:
    walk = BiasRandomWalk(v_per_sqrt_s=1.0)
    volts = in_order(walk, [at_rest(10, start_s=50.0), at_rest(3, first=10, start_s=20.0)])
    assert (volts[10:] == volts[9]).all()


def test_flicker_has_a_flat_allan_deviation_where_its_docstring_says() -> None:
    averages = np.array([10, 100, 1000])
    found = []
    for seed in range(24):
        volts = FlickerNoise(v_rms_per_decade=1e-3, seed=seed).apply(at_rest(50_000, interval_s=0.1)).output_v
        _, deviations, _, _ = allantools.oadev(volts, rate=10.0, data_type="freq", taus=averages / 10.0)
        found.append(deviations**2)
    # within the noise of 24 draws
    np.testing.assert_allclose(np.sqrt(np.mean(found, axis=0)), 0.776e-3, rtol=0.05)


def test_flicker_begins_stationary_and_goes_on_through_a_gap() -> None:
    draws = 600
    ends = np.array(
        [
            in_order(FlickerNoise(v_rms_per_decade=1.0, seed=seed), [at_rest(1), at_rest(1, first=1, start_s=3600.0)])
            for seed in range(draws)
        ]
    )
    whole = 26 * math.log10(2.0)  # octaves from 2⁻⁸ s to 2¹⁷ s
    tolerance = 5.0 * math.sqrt(2.0 / draws)
    np.testing.assert_allclose(ends.var(axis=0), whole, rtol=tolerance)
    # what is slower than the gap stays: time constants τ keep e^(−3600/τ)
    kept = math.log10(2.0) * sum(math.exp(-3600.0 / 2.0**k) for k in range(-8, 18))
    assert np.mean(ends[:, 0] * ends[:, 1]) == pytest.approx(kept, abs=5.0 * whole / math.sqrt(draws))
    assert kept > 1.0
