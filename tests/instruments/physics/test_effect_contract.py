"""The check that somebody who writes an effect runs: sound ones pass, broken ones are told with what they break."""

import doctest
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from benchctl_instruments.physics import effect_contract
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effect_contract import check_effect
from benchctl_instruments.physics.effect_contract.description import faults_in
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.effects.rate_squared import RateSquared

DESCRIBED = {**drive_effects(), **chamber_effects()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Sound(RateSquared):
    identifier: ClassVar[str] = "sound"


@dataclass(frozen=True, slots=True, kw_only=True)
class Overwriting(Sound):
    def apply(self, signals: Signals) -> Signals:
        signals.output_v[:] += self.v_per_dps2 * signals.sensed_rate_dps**2
        return signals


@dataclass(frozen=True, slots=True, kw_only=True)
class Lingering(Sound):
    def apply(self, signals: Signals) -> Signals:
        return replace(signals, output_v=signals.output_v + self.v_per_dps2 * signals.sensed_rate_dps**2 + 1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bending(Sound):
    def apply(self, signals: Signals) -> Signals:
        return replace(signals, output_v=signals.output_v + 1e6 * self.v_per_dps2**2 * signals.sensed_rate_dps)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grained(Sound):
    """What it does depends on how finely the signals are sampled."""

    def apply(self, signals: Signals) -> Signals:
        return replace(signals, output_v=signals.output_v + self.v_per_dps2 * np.gradient(signals.sensed_rate_dps))


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembering(Sound):
    """It says that it looks at each sample by itself, and looks at the one before."""

    pointwise: ClassVar[bool] = True

    def apply(self, signals: Signals) -> Signals:
        last = signals.memory.get("last", signals.sensed_rate_dps[:1])
        before = np.concatenate([last, signals.sensed_rate_dps[:-1]])
        memory = {**signals.memory, "last": signals.sensed_rate_dps[-1:]}
        return replace(signals, output_v=signals.output_v + self.v_per_dps2 * before**2, memory=memory)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hurrying(Sound):
    """It says that it does not mind when its samples were, and adds what grows with the time between them."""

    pointwise: ClassVar[bool] = False
    timeless: ClassVar[bool] = True

    def apply(self, signals: Signals) -> Signals:
        since = signals.time_s - signals.time_s[0]
        return replace(signals, output_v=signals.output_v + self.v_per_dps2 * since)


@dataclass(frozen=True, slots=True, kw_only=True)
class Silent(Sound):
    def says(self) -> str:
        return "something is wrong"


@dataclass(frozen=True, slots=True, kw_only=True)
class Raising(Sound):
    def apply(self, signals: Signals) -> Signals:
        raise ZeroDivisionError("no luck")


@dataclass(frozen=True, slots=True, kw_only=True)
class Alone(Sound):
    look_alikes: ClassVar[tuple[str, ...]] = ("gremlins",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unbounded(Sound):
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v_per_dps2": replace(RateSquared.parameters["v_per_dps2"], low=1.0, high=-1.0)
    }


def test_a_sound_effect_passes() -> None:
    check_effect(Sound)


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        (Overwriting, "read-only"),
        (Lingering, "At the zeros of its sizes, .* it changes nothing. But: AssertionError"),
        (Bending, "Twice the size does twice as much. But: AssertionError: v_per_dps2 at .* is not in proportion"),
        (Grained, "does not depend on how finely the signals are sampled"),
        (Remembering, "Where it is pointwise or timeless"),
        (Hurrying, "Where it is pointwise or timeless"),
        (Silent, "Its finding is a sentence with its numbers. But: AssertionError: it is 'something is wrong'"),
        (Raising, "ZeroDivisionError: no luck"),
        (Alone, "it looks like 'gremlins', and there is no such effect"),
        (Unbounded, "its parameter v_per_dps2 lies between 1.0 and -1.0, expected two finite bounds in order"),
    ],
    ids=lambda given: getattr(given, "__name__", ""),
)
def test_a_broken_effect_is_told_with_what_it_breaks(kind: type[Sound], says: str) -> None:
    with pytest.raises(AssertionError, match=rf"(?s){kind.__name__} does not keep what an effect must:\n- .*{says}"):
        check_effect(kind)


@pytest.mark.parametrize("name", sorted(DESCRIBED))
def test_every_effect_of_a_drive_and_of_a_chamber_is_described_likewise(name: str) -> None:
    assert list(faults_in(DESCRIBED[name], name)) == []
    check_effect(DESCRIBED[name])


@pytest.mark.parametrize("thing", [3, int, RateSquared(v_per_dps2=1e-6), object])
def test_what_is_no_effect_is_told(thing: object) -> None:
    (fault,) = faults_in(thing, "thing")
    assert "expected a class of effects" in fault


def test_its_example_runs_as_it_stands() -> None:
    assert doctest.testmod(effect_contract).attempted == 3
    assert doctest.testmod(effect_contract).failed == 0
