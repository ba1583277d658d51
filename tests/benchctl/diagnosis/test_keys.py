"""What tells the effects of a model apart."""

from __future__ import annotations

from dataclasses import replace

from benchctl.diagnosis.keys import keys_of, keys_of_names, may_join, place_of, tables_of
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from tests.benchctl.diagnosis.toy_problem import Cubic, Ripple

ONCE = Ripple(amplitude_v=1e-3, phase_deg=10.0, order=1.0)
TWICE = Ripple(amplitude_v=2e-3, phase_deg=20.0, order=2.0)
CUBIC = Cubic(size_v=1e-3)


def test_the_first_of_a_kind_is_named_by_its_identifier_and_others_are_numbered() -> None:
    assert keys_of((ONCE, CUBIC, TWICE)) == ("ripple", "cubic", "ripple_2")
    assert keys_of_names(["a", "a", "b", "a"]) == ("a", "a_2", "b", "a_3")
    assert keys_of(()) == ()


def test_the_tables_of_a_model_file_lose_none_of_a_kind_and_are_read_back_as_they_were() -> None:
    made = make_effects(
        {
            "heading_dependent_bias": {"amplitude_v": 0.2, "phase_deg": 30.0, "order": 2.0},
            "heading_dependent_bias_2": {"amplitude_v": 0.1, "phase_deg": 70.0, "order": 1.0},
            "warm_up": {"amplitude_v": 0.1, "tau_s": 900.0},
        }
    )
    tables = tables_of(made)
    assert list(tables) == ["heading_dependent_bias", "heading_dependent_bias_2", "warm_up"]
    assert make_effects(tables) == made


def test_the_place_of_an_effect_stays_when_its_numbers_move() -> None:
    assert place_of(replace(ONCE, amplitude_v=5.0, phase_deg=5.0)) == place_of(ONCE) == ("ripple", (1.0,))
    assert place_of(TWICE) == ("ripple", (2.0,))
    assert place_of(CUBIC) == ("cubic", ())


def test_another_of_a_kind_joins_at_another_order_only() -> None:
    assert may_join(TWICE, (CUBIC, ONCE))
    assert not may_join(replace(ONCE, amplitude_v=7.0), (CUBIC, ONCE))
    assert not may_join(ONCE, (ONCE, TWICE))
    assert may_join(CUBIC, (ONCE, TWICE))
    assert not may_join(CUBIC, (CUBIC,))


def test_a_second_low_pass_does_not_join() -> None:
    first = SensorBandwidth(cutoff_hz=20.0, order=1.0)
    assert not may_join(replace(first, order=2.0), (first,))


def test_several_there_may_be_only_of_what_has_an_order_to_choose() -> None:
    several = {name for name, kind in {**effects(), **drive_effects()}.items() if kind.several}
    assert several == {"cogging_torque", "encoder_eccentricity", "heading_dependent_bias"}
    for name in several:
        order = {**effects(), **drive_effects()}[name].parameters["order"]
        assert order.role == "choice"
        assert not order.by_scan
