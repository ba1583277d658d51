from __future__ import annotations

import numpy as np
import pytest

from benchctl.diagnosis.search.scan_ends import fold_places, limit_places, onset_places, rail_places
from benchctl_instruments.physics.effects.fringe_ambiguity import folded_dps
from tests.benchctl.diagnosis.pulled import FloatArray, pulled

RATES_DPS = np.repeat([0.0, 5.0, -5.0, 40.0, -40.0, 90.0, -90.0, 130.0, -130.0, 150.0, -150.0], 400)
SCALE_V_PER_DPS = 3.0
"""In deviations of the noise, as is the residual."""


def _known(rates: FloatArray) -> FloatArray:
    return np.stack([np.ones_like(rates), rates, rates**3], axis=1)


@pytest.mark.parametrize("fold_dps", [20.0, 61.0, 118.0, 141.0])
def test_a_fold_is_found_between_the_rates_that_it_parts(fold_dps: float) -> None:
    rates = RATES_DPS + np.random.default_rng(2).uniform(-1.0, 1.0, RATES_DPS.size)
    noise = np.random.default_rng(1).standard_normal(rates.size)
    residual = noise + SCALE_V_PER_DPS * (folded_dps(rates, fold_dps) - rates)
    best = fold_places(pulled(residual, _known(rates)), rates, SCALE_V_PER_DPS, 3)[0]
    assert best.value == pytest.approx(fold_dps, abs=1.0)


def test_a_fold_is_found_though_the_scale_factor_was_fitted_without_it() -> None:
    noise = np.random.default_rng(1).standard_normal(RATES_DPS.size)
    residual = noise + 1.3 * SCALE_V_PER_DPS * (folded_dps(RATES_DPS, 100.0) - RATES_DPS)
    best = fold_places(pulled(residual, _known(RATES_DPS)), RATES_DPS, SCALE_V_PER_DPS, 1)[0]
    assert 90.0 < best.value < 130.0


def test_noise_promises_no_fold() -> None:
    noise = np.random.default_rng(1).standard_normal(RATES_DPS.size)
    assert fold_places(pulled(noise, _known(RATES_DPS)), RATES_DPS, SCALE_V_PER_DPS, 3) == []


def test_a_table_at_rest_has_no_fold() -> None:
    rates = np.zeros(500)
    assert fold_places(pulled(np.ones(500)), rates, SCALE_V_PER_DPS, 3) == []


OUTPUT_V = 0.03 * RATES_DPS
DEVIATIONS_PER_V = 100.0


@pytest.mark.parametrize("limit_v", [0.4, 2.0, 3.95, 4.4])
def test_a_limit_is_found_between_the_outputs_that_it_parts(limit_v: float) -> None:
    outputs = OUTPUT_V + np.random.default_rng(2).uniform(-0.03, 0.03, OUTPUT_V.size)
    noise = np.random.default_rng(1).standard_normal(outputs.size)
    residual = noise + DEVIATIONS_PER_V * (np.clip(outputs, -limit_v, limit_v) - outputs)
    known = np.stack([np.ones_like(outputs), outputs, outputs**3, outputs**5], axis=1)
    best = limit_places(pulled(residual, known), DEVIATIONS_PER_V * outputs, 3)[0]
    assert best.value / DEVIATIONS_PER_V == pytest.approx(limit_v, abs=0.1)


def test_noise_promises_no_limit() -> None:
    noise = np.random.default_rng(1).standard_normal(OUTPUT_V.size)
    assert limit_places(pulled(noise, _known(RATES_DPS)), DEVIATIONS_PER_V * OUTPUT_V, 3) == []


RAILS_V = [(-2.0, 3.95), (-4.2, 2.6), (-5.0, 3.0), (0.4, 3.0)]
"""The third has one rail only."""


@pytest.mark.parametrize(("lower_v", "upper_v"), RAILS_V)
def test_two_rails_are_found_between_the_outputs_that_they_part(lower_v: float, upper_v: float) -> None:
    outputs = OUTPUT_V + np.random.default_rng(2).uniform(-0.03, 0.03, OUTPUT_V.size)
    noise = np.random.default_rng(1).standard_normal(outputs.size)
    residual = noise + DEVIATIONS_PER_V * (np.clip(outputs, lower_v, upper_v) - outputs)
    known = np.stack([np.ones_like(outputs), outputs, outputs**3, outputs**5], axis=1)
    best = rail_places(pulled(residual, known), DEVIATIONS_PER_V * outputs, 3)[0]
    found = np.array([best.lower_v, best.upper_v]) / DEVIATIONS_PER_V
    assert found == pytest.approx([max(lower_v, outputs.min()), upper_v], abs=0.1)


def test_noise_promises_no_rails() -> None:
    noise = np.random.default_rng(1).standard_normal(OUTPUT_V.size)
    assert all(one.gain < 14.0 for one in rail_places(pulled(noise, _known(RATES_DPS)), DEVIATIONS_PER_V * OUTPUT_V, 3))


@pytest.mark.parametrize("scale", [SCALE_V_PER_DPS, -SCALE_V_PER_DPS])
@pytest.mark.parametrize("onset_dps", [61.0, 118.0, 141.0])
def test_the_onset_of_an_overload_is_found_whatever_it_takes(onset_dps: float, scale: float) -> None:
    rates = RATES_DPS + np.random.default_rng(2).uniform(-1.0, 1.0, RATES_DPS.size)
    noise = np.random.default_rng(1).standard_normal(rates.size)
    residual = noise - 1.4 * scale * np.sign(rates) * np.maximum(np.abs(rates) - onset_dps, 0.0)
    best = onset_places(pulled(residual, _known(rates)), rates, scale * rates, 3)[0]
    assert best.value == pytest.approx(onset_dps, abs=1.0)
