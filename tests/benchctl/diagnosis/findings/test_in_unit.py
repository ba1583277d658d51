"""A gyro that states its rate has no volts: neither in sentences nor in the units of parameters."""

import re

import pytest

from benchctl.diagnosis.findings.in_unit import (
    estimates_in,
    finding_in,
    pieces_in_time,
    text_in,
    unexplained_in,
    unit_in,
)
from benchctl.diagnosis.result import Estimate, Finding, Unexplained, Where
from benchctl_instruments.physics.effects.registry import effects


@pytest.mark.parametrize("name", effects())
def test_no_effect_speaks_of_volts_of_a_digital_gyro_but_of_its_supply(name: str) -> None:
    kind = effects()[name]
    values = {each: parameter.scan[0] for each, parameter in kind.parameters.items()}
    said = text_in(kind.make(values).says(), "°/s")
    assert not re.search(r"\d ?(mV|µV|V)\b", re.sub(r"(volt|V) (of|more) .*supply", "", said)), said
    for parameter in kind.parameters.values():
        assert not unit_in(parameter.unit, "°/s").startswith("V ")


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("The bias rises by 780 mV an hour, steadily.", "The bias rises by 0.78 °/s an hour, steadily."),
        ("by -3.2 µV and +0.5 V", "by -3.2e-06 °/s and +0.5 °/s"),
        ("most at 1.2 to 3 V", "most at 1.2 to 3 °/s"),
    ],
)
def test_sizes_keep_their_value(said: str, told: str) -> None:
    # "to 3 V": of two numbers the last has the unit
    assert text_in(said, "°/s") == told


def test_the_friction_of_a_motor_whose_voltage_was_recorded_is_in_volts() -> None:
    friction = Finding(
        effect="coulomb_friction",
        probability=1.0,
        parameters={"coulomb_nm": Estimate(value=0.3, low=0.2, high=0.4, unit="N m")},
        where=Where(coordinate="rate_sign", ranges=(), steps=(), share_of_excess=1.0),
        explains=1.0,
        gain=100.0,
        gain_heldout=50.0,
        says="Dry (Coulomb) friction of 0.3 N·m works against the motion.",
    )
    in_volts = finding_in(friction, "V", "drive")
    assert in_volts.says == "Dry (Coulomb) friction of 0.3 V works against the motion."
    assert in_volts.parameters["coulomb_nm"].unit == "V"
    assert finding_in(friction, "N m", "drive") == friction


def test_values_stay_and_units_follow() -> None:
    walk = Estimate(value=2.0, low=1.0, high=3.0, unit="V s-0.5")
    assert estimates_in({"v_per_sqrt_s": walk}, "°/s") == {
        "v_per_sqrt_s": Estimate(value=2.0, low=1.0, high=3.0, unit="°/s s-0.5")
    }
    assert unit_in("V-1", "°/s") == "V-1"


def test_what_is_left_of_a_chamber_depends_on_its_air_and_is_no_bias() -> None:
    says = "It lives in the output, most at -44.9 to -34.4 K. Closest generic form: a bias that depends on the output."
    left = Unexplained(significant=True, share=0.1, coordinates=("output",), says=says)
    told = unexplained_in(left, "K", "chamber").says
    assert told.startswith("It lives in the air's temperature, most at -44.9 to -34.4 K.")
    assert told.endswith("an offset that depends on the air's temperature.")


def test_what_differs_between_pieces_of_one_step_changes_with_time() -> None:
    left = Unexplained(
        significant=True,
        share=0.1,
        coordinates=("step", "time"),
        says="The residual is not noise: it depends on the steps; no known effect accounts for it. Closest generic"
        " form: a bias that changes with the step. This recording does not separate it from time.",
    )
    told = pieces_in_time(left)
    assert told.coordinates == ("time",)
    assert told.says == (
        "The residual is not noise: it depends on time; no known effect accounts for it. Closest generic"
        " form: a bias that changes with time."
    )
