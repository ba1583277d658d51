"""What every effect must keep, whoever adds it: this walks the registry."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, replace
from typing import ClassVar

import numpy as np
import pytest

from benchctl.diagnosis.result import COORDINATES
from instruments.errors import UsageError
from instruments.interfaces import FloatArray
from instruments.physics.chain import STAGES, Signals
from instruments.physics.effects import registry
from instruments.physics.effects.effect import PhysicalEffect
from instruments.physics.effects.kinds import ClockEffect, ComplexArray, EncoderEffect, FilterEffect, NoiseEffect
from instruments.physics.effects.registry import effect, effects
from instruments.physics.effects.saturation import Saturation
from tests.instruments.physics.effects.motion import (
    CIRCUMSTANCES,
    COARSE_HZ,
    FINE,
    PERIOD_S,
    N,
    arrays,
    at,
    in_chunks,
    sampled,
    stretch,
)
from tests.shared import SHARED, needs_shared

KINDS = list(effects().values())
DRAWN = [kind for kind in KINDS if issubclass(kind, NoiseEffect)]
"""Random: of these only what does not depend on the draw can be asked."""
DETERMINED = [kind for kind in KINDS if kind not in DRAWN]
FILTERS = [kind for kind in DETERMINED if issubclass(kind, FilterEffect)]
INSTANT = [kind for kind in DETERMINED if kind not in FILTERS]

every = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.identifier)
every_determined = pytest.mark.parametrize("kind", DETERMINED, ids=lambda kind: kind.identifier)
every_filter = pytest.mark.parametrize("kind", FILTERS, ids=lambda kind: kind.identifier)
every_instant = pytest.mark.parametrize("kind", INSTANT, ids=lambda kind: kind.identifier)


def combinations(kind: type[PhysicalEffect]) -> list[dict[str, float]]:
    """Every combination of values at which a search begins."""
    scans = [parameter.scan for parameter in kind.parameters.values()]
    return [dict(zip(kind.parameters, values, strict=True)) for values in itertools.product(*scans)]


def plain(kind: type[PhysicalEffect]) -> dict[str, float]:
    """Values in the middle of where a search begins."""
    return {name: parameter.scan[len(parameter.scan) // 2] for name, parameter in kind.parameters.items()}


def outcome(made: PhysicalEffect, signals: Signals) -> dict[str, FloatArray]:
    """Everything that an effect can be seen to do to signals."""
    seen = arrays(made.apply(signals))
    if isinstance(made, ClockEffect):
        seen["gyro_time_s"] = made.gyro_time_s(signals.time_s)
    if isinstance(made, EncoderEffect):
        seen["error_slope"] = made.error_slope(signals.angle_deg)
    return seen


def without(signals: Signals) -> dict[str, FloatArray]:
    """The outcome of no effect."""
    return {**arrays(signals), "gyro_time_s": signals.time_s, "error_slope": np.zeros_like(signals.time_s)}


def change(made: PhysicalEffect, signals: Signals) -> FloatArray:
    """What an effect changes, all in one array."""
    ideal = without(signals)
    return np.concatenate([array - ideal[name] for name, array in outcome(made, signals).items()])


@needs_shared("spec/effects.md")
def test_the_vocabulary_is_there_under_its_own_names() -> None:
    rows = re.findall(r"^\| `(\w+)` \|.*\| (.+) \|$", (SHARED / "spec" / "effects.md").read_text("utf-8"), re.M)
    assert len(rows) > 20
    for identifier, parameters in rows:
        named, ours = re.findall(r"`(\w+)`", parameters), effect(identifier).parameters
        if " or " in parameters:
            assert set(ours) <= set(named), identifier
        else:
            assert list(ours)[: len(named)] == named, identifier
            # what the vocabulary does not name, an angle at most
            assert all(parameter.role == "phase" for name, parameter in ours.items() if name not in named), identifier


@every
def test_it_describes_itself(kind: type[PhysicalEffect]) -> None:
    assert effects()[kind.identifier] is kind
    assert kind.stage in STAGES
    assert kind.words.endswith(".")
    assert len(kind.words) > 40
    assert kind.equation
    assert kind.excited_by
    assert 1 <= len(kind.coordinate.split("*")) <= 2
    assert set(kind.coordinate.split("*")) <= set(COORDINATES)
    assert set(kind.look_alikes) <= set(effects()) - {kind.identifier}


@every
def test_its_fields_are_its_parameters_and_then_its_circumstances(kind: type[PhysicalEffect]) -> None:
    its_fields = fields(kind)  # type: ignore[arg-type]  # subclasses are dataclasses
    count = len(kind.parameters)
    assert [field.name for field in its_fields[:count]] == list(kind.parameters)
    assert all(field.default is not MISSING for field in its_fields[count:])


@every
def test_its_parameters_can_be_searched(kind: type[PhysicalEffect]) -> None:
    for parameter in kind.parameters.values():
        assert parameter.unit
        assert parameter.meaning
        assert -math.inf < parameter.low < parameter.high < math.inf
        assert parameter.scan
        assert all(parameter.low <= value <= parameter.high for value in parameter.scan)
        assert parameter.low > 0.0 or not parameter.logarithmic
        if parameter.role == "size":
            assert parameter.zero is not None
            assert len(parameter.scan) == 1
            assert parameter.scan[0] != parameter.zero
        if parameter.role == "phase":
            assert parameter.unit == "degree"
            assert parameter.high - parameter.low == 360.0
    assert any(parameter.zero is not None for parameter in kind.parameters.values())


@every
def test_its_finding_is_a_sentence_with_numbers(kind: type[PhysicalEffect]) -> None:
    made = kind.make(plain(kind), CIRCUMSTANCES)
    assert made.values == pytest.approx(plain(kind))
    assert re.fullmatch(r"[A-Z][^\n]*\d[^\n]*\.", made.says())
    assert "nan" not in made.says()


@every
def test_it_is_gone_at_its_zero(kind: type[PhysicalEffect]) -> None:
    signals, ideal = sampled(), without(sampled())
    zeros = {name: p.zero for name, p in kind.parameters.items() if p.zero is not None}
    sizes = {name: zero for name, zero in zeros.items() if kind.parameters[name].role == "size"}
    # sizes go together; of the others each is enough
    for gone in filter(None, (sizes, *({name: zeros[name]} for name in set(zeros) - set(sizes)))):
        if issubclass(kind, FilterEffect):
            nearly = {name: min(zero, 1e9) for name, zero in gone.items()}
            gain = kind.make({**plain(kind), **nearly}, CIRCUMSTANCES).response(np.linspace(0.0, 50.0, 101))
            np.testing.assert_allclose(gain, 1.0, rtol=0.0, atol=1e-6)
            continue
        for name, array in outcome(kind.make({**plain(kind), **gone}, CIRCUMSTANCES), signals).items():
            np.testing.assert_allclose(array, ideal[name], rtol=1e-9, atol=1e-9, err_msg=f"{name} at {gone}")


@every_determined
def test_it_grows_in_proportion_to_its_sizes(kind: type[PhysicalEffect]) -> None:
    signals = sampled()
    sizes = {name: p for name, p in kind.parameters.items() if p.role == "size"}
    none: dict[str, float] = {name: 0.0 if p.zero is None else p.zero for name, p in sizes.items()}
    for name, parameter in sizes.items():
        for values in combinations(kind):
            once, twice = (
                change(kind.make({**values, **none, name: none[name] + n * parameter.scan[0]}, CIRCUMSTANCES), signals)
                for n in (1.0, 2.0)
            )
            assert np.abs(once).max() > 0.0, f"{name} at {values}"
            assert np.std(twice - 2.0 * once) <= 2e-3 * np.std(once), f"{name} at {values}"


@every_instant
def test_a_run_at_sixteen_times_the_rate_says_the_same(kind: type[PhysicalEffect]) -> None:
    coarse, fine = sampled(), sampled(FINE)
    for values in combinations(kind):
        made = kind.make(values, CIRCUMSTANCES)
        finer, ideal = outcome(made, fine), without(coarse)
        for name, array in outcome(made, coarse).items():
            size = np.abs(array - ideal[name]).max()
            np.testing.assert_allclose(
                array, finer[name][::FINE], rtol=0.0, atol=1e-3 * size + 1e-10, err_msg=f"{name} {values}"
            )


@every_filter
def test_the_difference_equation_of_a_filter_is_its_response(kind: type[PhysicalEffect]) -> None:
    coarse = sampled()
    frequencies: FloatArray = np.fft.rfftfreq(N, coarse.interval_s).astype(np.float64)
    for values in combinations(kind):
        made = kind.make(values, CIRCUMSTANCES)
        assert isinstance(made, FilterEffect)
        assert made.response(np.zeros(1))[0] == pytest.approx(1.0, abs=1e-12)
        periods = math.ceil(made.memory_s / PERIOD_S)
        fine = sampled(FINE, periods + 1)
        x: FloatArray = getattr(coarse, made.filtered)
        spectrum: ComplexArray = np.fft.rfft(x).astype(np.complex128)
        gain = made.response(frequencies)
        exact = np.fft.irfft(spectrum * gain, N)
        ours: FloatArray = getattr(made.apply(fine), made.filtered)[periods * FINE * N :: FINE]
        # an input that runs straight from sample to sample is off by its curvature, (ΔT)²/12 of it
        curvature = np.abs(np.diff(x, 2)).max() / coarse.interval_s**2
        missed = np.abs(gain[frequencies < 10.0]).max() * curvature * fine.interval_s**2 / 12.0
        np.testing.assert_allclose(ours, exact, rtol=0.0, atol=1.5 * missed + 1e-10, err_msg=f"{values}")


@every_filter
def test_a_filter_forgets_within_its_memory(kind: type[PhysicalEffect]) -> None:
    begin = FINE * N // 4
    for values in combinations(kind):
        made = kind.make(values, CIRCUMSTANCES)
        assert isinstance(made, FilterEffect)
        fine = sampled(FINE, 1 + math.ceil(made.memory_s / PERIOD_S))
        forgotten = math.ceil(made.memory_s / fine.interval_s)
        whole: FloatArray = getattr(made.apply(fine), made.filtered)
        fresh: FloatArray = getattr(made.apply(stretch(fine, begin, fine.time_s.size, {})), made.filtered)
        np.testing.assert_allclose(
            fresh[forgotten:], whole[begin + forgotten :], rtol=0.0, atol=1e-6 * np.abs(whole).max()
        )
        assert fresh[forgotten:].size > 0


@every
@pytest.mark.parametrize("cuts", [(1000,), (1, 2, 137, 138, 900, 1999)], ids=["two", "many"])
def test_a_run_in_chunks_is_the_run_in_one_piece(kind: type[PhysicalEffect], cuts: tuple[int, ...]) -> None:
    made, signals = kind.make(plain(kind), CIRCUMSTANCES), sampled()
    whole = arrays(made.apply(signals))
    for name, array in in_chunks(made, signals, cuts).items():
        np.testing.assert_allclose(array, whole[name], rtol=1e-9, atol=1e-9, err_msg=name)


@every
def test_it_is_finite_at_its_bounds(kind: type[PhysicalEffect]) -> None:
    signals = sampled()
    for values in itertools.product(*((p.low, p.high) for p in kind.parameters.values())):
        made = kind.make(dict(zip(kind.parameters, values, strict=True)), CIRCUMSTANCES)
        for name, array in outcome(made, signals).items():
            assert np.isfinite(array).all(), f"{name} at {made}"
        assert made.says()


@every
def test_it_counts_its_time_from_the_start_of_the_recording(kind: type[PhysicalEffect]) -> None:
    values = plain(kind)
    ideal = outcome(kind.make(values, CIRCUMSTANCES), sampled())
    later = replace(sampled(), time_s=sampled().time_s + 1000.0137)
    moved = outcome(kind.make(values, {**CIRCUMSTANCES, "start_s": 1000.0137}), later)
    for name in set(moved) - {"time_s"}:
        shift = 1000.0137 if name == "gyro_time_s" else 0.0
        np.testing.assert_allclose(moved[name] - shift, ideal[name], rtol=1e-9, atol=1e-9, err_msg=name)


@every
def test_it_writes_to_nothing_that_it_was_given(kind: type[PhysicalEffect]) -> None:
    signals = at(sampled().time_s.copy(), 1.0 / COARSE_HZ)
    for array in arrays(signals).values():
        array.setflags(write=True)
    before = {name: array.copy() for name, array in arrays(signals).items()}
    kind.make(plain(kind), CIRCUMSTANCES).apply(signals)
    for name, array in arrays(signals).items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)


def test_an_effect_that_is_not_there_is_said_so() -> None:
    with pytest.raises(UsageError, match=r"'gremlins': there is no such effect; there are adc_coarse, .*, warm_up$"):
        effect("gremlins")


class Gremlins(Saturation):
    identifier: ClassVar[str] = "gremlins"


class Impostor(Saturation):
    """An effect of somebody else's under a name of ours."""


@dataclass(frozen=True)
class Point:
    kind: type[PhysicalEffect]

    def load(self) -> type[PhysicalEffect]:
        return self.kind


@pytest.fixture
def fresh_registry() -> Iterator[None]:
    effects.cache_clear()
    yield
    effects.cache_clear()


@pytest.mark.usefixtures("fresh_registry")
def test_third_parties_add_effects_but_replace_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def points(*, group: str) -> list[Point]:
        assert group == "benchctl.effects"
        return [Point(Gremlins), Point(Impostor)]

    monkeypatch.setattr(registry, "entry_points", points)
    assert effects()["gremlins"] is Gremlins
    assert effects()["saturation"] is Saturation
    assert list(effects()) == sorted(effects())
