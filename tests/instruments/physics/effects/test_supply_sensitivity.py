from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchctl_instruments.physics.effect_contract.behaviour import at
from benchctl_instruments.physics.effects.supply_sensitivity import SupplySensitivity

SENSITIVE = SupplySensitivity(fraction_per_v=0.01, v_per_v=0.002)


def test_scale_and_bias_follow_the_supply_from_its_first_sample_on() -> None:
    signals = replace(
        at(np.arange(3.0), 1.0),
        output_v=np.array([2.0, 2.0, 0.0]),
        auxiliary={"humidity": np.arange(3.0), "supply_12_v": np.array([12.0, 11.0, 11.0])},
    )
    first = SENSITIVE.apply(signals)
    np.testing.assert_allclose(first.output_v, [2.0, 2.0 * 0.99 - 0.002, -0.002], rtol=1e-12)
    later = SENSITIVE.apply(replace(signals, auxiliary={"supply_12_v": np.full(3, 14.0)}, memory=first.memory))
    np.testing.assert_allclose(later.output_v, [2.044, 2.044, 0.004], rtol=1e-12)


def test_where_no_supply_was_recorded_nothing_happens() -> None:
    signals = replace(at(np.arange(3.0), 1.0), auxiliary={"humidity": np.arange(3.0)})
    assert SENSITIVE.apply(signals) is signals
