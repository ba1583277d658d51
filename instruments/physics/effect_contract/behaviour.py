"""The contract of an effect's behaviour: each promise is a function that raises `AssertionError` if it is violated.

Promises are checked at the values at which a search begins, on signals of a smooth motion while the coil warms and
cools. For random effects, only promises that do not depend on the draw are checked.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np

from benchctl_instruments.arrays import ComplexArray, FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.kinds import ClockEffect, EncoderEffect, FilterEffect, NoiseEffect

COARSE_HZ = 125.0
FINE = 16
PERIOD_S = 16.0
N = round(PERIOD_S * COARSE_HZ)

CIRCUMSTANCES = {"T0_c": 20.0, "range_dps": 180.0, "seed": 3.0, "start_s": 0.0}

_SINES = ((1.0 / 16.0, 150.0, 0.3), (1.5, 20.0, 1.1), (6.25, 5.0, 2.0))
"""Frequency [Hz], amplitude [deg/s] and phase [rad] of the parts of the motion: complete turns, up to 172 deg/s."""


def at(time_s: FloatArray, interval_s: float, first_index: int = 0) -> Signals:
    """Return the motion at instants, in read-only arrays."""
    angle, rate, acceleration = (np.zeros_like(time_s) for _ in range(3))
    for frequency, amplitude, phase in _SINES:
        omega = 2.0 * np.pi * frequency
        angle -= amplitude / omega * np.cos(omega * time_s + phase)
        rate += amplitude * np.sin(omega * time_s + phase)
        acceleration += amplitude * omega * np.cos(omega * time_s + phase)
    slow = 2.0 * np.pi / PERIOD_S
    coil = 30.0 + 25.0 * np.sin(slow * time_s - 0.5)
    signals = Signals(
        interval_s=interval_s,
        time_s=time_s,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=acceleration,
        housing_c=coil,
        coil_c=coil,
        sensed_rate_dps=rate,
        output_v=0.05 * rate,
        encoder_deg=angle,
        thermistor_c=coil,
        coil_rate_c_per_s=25.0 * slow * np.cos(slow * time_s - 0.5),
        first_index=first_index,
        auxiliary={"supply_v": 5.0 + 0.2 * np.sin(slow * time_s)},
    )
    for array in (*arrays(signals).values(), *signals.auxiliary.values()):
        array.setflags(write=False)
    return signals


@lru_cache(maxsize=8)
def sampled(finer: int = 1, periods: int = 1) -> Signals:
    """Return `periods` periods at `finer` times the coarse rate; every `finer`-th sample is a coarse sample."""
    interval_s = 1.0 / (COARSE_HZ * finer)
    return at(np.arange(periods * N * finer, dtype=np.float64) * interval_s, interval_s)


def stretch(signals: Signals, low: int, high: int, memory: Mapping[str, FloatArray]) -> Signals:
    """Return a segment of signals with the memory of the preceding one."""
    part = {name: array[low:high] for name, array in arrays(signals).items()}
    auxiliary = {name: array[low:high] for name, array in signals.auxiliary.items()}
    return replace(signals, **part, auxiliary=auxiliary, memory=memory, first_index=signals.first_index + low)  # type: ignore[arg-type]  # every field of `part` is an array


def in_chunks(effect: PhysicalEffect, signals: Signals, cuts: Sequence[int]) -> dict[str, FloatArray]:
    """Return the effect's output for signals cut into segments."""
    memory: dict[str, FloatArray] = {}
    parts = []
    for low, high in itertools.pairwise((0, *cuts, signals.time_s.size)):
        done = effect.apply(stretch(signals, low, high, memory))
        memory = {name: np.array(array) for name, array in done.memory.items()}
        for array in memory.values():
            array.setflags(write=False)
        parts.append(arrays(done))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def arrays(signals: Signals) -> dict[str, FloatArray]:
    """Return the arrays of signals by name."""
    values = {field.name: getattr(signals, field.name) for field in fields(signals)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


Kind = type[PhysicalEffect]
Promise = Callable[[Kind], None]

_CUTS = ((1000,), (1, 2, 137, 138, 900, 1999))
_LOST_AT = 900
_MOST_TOGETHER = 10
"""Up to this number of parameters, every corner of the bounds is checked."""
_LOST_S = 300.0


def says_a_sentence_with_numbers(kind: Kind) -> None:
    """Its finding is a sentence with its numbers."""
    made = kind.make(_plain(kind), CIRCUMSTANCES)
    _require(made.values == _plain(kind), f"its values are {made.values}, it was made of {_plain(kind)}")
    text = made.says()
    _require(re.fullmatch(r"[A-Z][^\n]*\d[^\n]*\.", text) is not None and "nan" not in text, f"it is {text!r}")


def is_gone_at_its_zero(kind: Kind) -> None:
    """At the zeros of its sizes, and at the zero of each other parameter that has one, it changes nothing."""
    signals, ideal = sampled(), _without(sampled())
    zeros = {name: p.zero for name, p in kind.parameters.items() if p.zero is not None}
    sizes = {name: zero for name, zero in zeros.items() if kind.parameters[name].role == "size"}
    # sizes vanish together, as do two ends of a range; of the others each alone is enough
    ends = zeros if set(zeros.values()) == {-math.inf, math.inf} else {}
    others = ({name: zeros[name]} for name in set(zeros) - set(sizes) - set(ends))
    for gone in filter(None, (sizes, ends, *others)):
        if issubclass(kind, FilterEffect):
            nearly = {name: min(zero, 1e9) for name, zero in gone.items()}
            gain = kind.make({**_plain(kind), **nearly}, CIRCUMSTANCES).response(np.linspace(0.0, 50.0, 101))
            np.testing.assert_allclose(gain, 1.0, rtol=0.0, atol=1e-6)
            continue
        for name, array in _outcome(kind.make({**_plain(kind), **gone}, CIRCUMSTANCES), signals).items():
            np.testing.assert_allclose(array, ideal[name], rtol=1e-9, atol=1e-9, err_msg=f"{name} at {gone}")


def grows_in_proportion_to_its_sizes(kind: Kind) -> None:
    """Twice the size does twice as much."""
    if _is_drawn(kind):
        return
    signals = sampled()
    sizes = {name: p for name, p in kind.parameters.items() if p.role == "size"}
    none: dict[str, float] = {name: 0.0 if p.zero is None else p.zero for name, p in sizes.items()}
    for name, parameter in sizes.items():
        for values in _combinations(kind):
            once, twice = (
                _change(kind.make({**values, **none, name: none[name] + n * parameter.scan[0]}, CIRCUMSTANCES), signals)
                for n in (1.0, 2.0)
            )
            _require(np.abs(once).max() > 0.0, f"{name} does nothing at {values}")
            _require(np.std(twice - 2.0 * once) <= 2e-3 * np.std(once), f"{name} at {values} is not in proportion")


def says_the_same_at_sixteen_times_the_rate(kind: Kind) -> None:
    """Its effect at an instant does not depend on how finely the signals are sampled; for filters see the next one."""
    if _is_drawn(kind) or issubclass(kind, FilterEffect):
        return
    coarse, fine = sampled(), sampled(FINE)
    for values in _combinations(kind):
        made = kind.make(values, CIRCUMSTANCES)
        finer, ideal = _outcome(made, fine), _without(coarse)
        for name, array in _outcome(made, coarse).items():
            size = np.abs(array - ideal[name]).max()
            np.testing.assert_allclose(
                array, finer[name][::FINE], rtol=0.0, atol=1e-3 * size + 1e-10, err_msg=f"{name} {values}"
            )


def filters_as_its_response_says(kind: Kind) -> None:
    """The difference equation of a filter agrees with its response; its gain at 0 Hz is 1."""
    if not issubclass(kind, FilterEffect):
        return
    coarse = sampled()
    frequencies: FloatArray = np.fft.rfftfreq(N, coarse.interval_s).astype(np.float64)
    for values in _combinations(kind):
        made = kind.make(values, CIRCUMSTANCES)
        np.testing.assert_allclose(made.response(np.zeros(1)), 1.0, rtol=0.0, atol=1e-12)
        periods = math.ceil(made.memory_s / PERIOD_S)
        fine = sampled(FINE, periods + 1)
        x: FloatArray = getattr(coarse, made.filtered)
        spectrum: ComplexArray = np.fft.rfft(x).astype(np.complex128)
        gain = made.response(frequencies)
        exact = np.fft.irfft(spectrum * gain, N)
        ours: FloatArray = getattr(made.apply(fine), made.filtered)[periods * FINE * N :: FINE]
        # linear interpolation of the input causes an error of (ΔT)²/12 of its curvature
        curvature = np.abs(np.diff(x, 2)).max() / coarse.interval_s**2
        missed = np.abs(gain[frequencies < 10.0]).max() * curvature * fine.interval_s**2 / 12.0
        np.testing.assert_allclose(ours, exact, rtol=0.0, atol=1.5 * missed + 1e-10, err_msg=f"{values}")


def forgets_within_its_memory(kind: Kind) -> None:
    """After `memory_s` a filter has forgotten its initial state."""
    if not issubclass(kind, FilterEffect):
        return
    begin = FINE * N // 4
    for values in _combinations(kind):
        made = kind.make(values, CIRCUMSTANCES)
        fine = sampled(FINE, 1 + math.ceil(made.memory_s / PERIOD_S))
        forgotten = math.ceil(made.memory_s / fine.interval_s)
        continuous: FloatArray = getattr(made.apply(fine), made.filtered)
        fresh: FloatArray = getattr(made.apply(stretch(fine, begin, fine.time_s.size, {})), made.filtered)
        _require(fresh[forgotten:].size > 0, f"it remembers {made.memory_s:g} s at {values}")
        np.testing.assert_allclose(
            fresh[forgotten:], continuous[begin + forgotten :], rtol=0.0, atol=1e-6 * np.abs(continuous).max()
        )


def is_the_same_in_chunks(kind: Kind) -> None:
    """A run cut into chunks, each with the memory of the previous one, equals the uncut run."""
    made, signals = kind.make(_plain(kind), CIRCUMSTANCES), sampled()
    uncut = arrays(made.apply(signals))
    for cuts in _CUTS:
        for name, array in in_chunks(made, signals, cuts).items():
            np.testing.assert_allclose(array, uncut[name], rtol=1e-9, atol=1e-9, err_msg=f"{name}, cut at {cuts}")


def may_be_given_stretches_together_where_it_says_so(kind: Kind) -> None:
    """Where it is pointwise or timeless, segments passed together give the same output as segments passed in turn."""
    if not (kind.pointwise or kind.timeless):
        return
    made, signals = kind.make(_plain(kind), CIRCUMSTANCES), _with_time_lost()
    together = arrays(made.apply(replace(signals, interval_s=1.0, first_index=0)))
    apart = in_chunks(made, signals, (_LOST_AT,))
    if kind.pointwise:
        apart = {name: array[::-1] for name, array in apart.items()}
        together = arrays(made.apply(_reversed(signals)))
    for name, array in apart.items():
        np.testing.assert_allclose(together[name], array, rtol=1e-12, atol=1e-12, err_msg=name)


def is_finite_at_its_bounds(kind: Kind) -> None:
    """At its bounds its output is finite, and its finding is not empty."""
    signals = sampled()
    for values in _corners(kind):
        made = kind.make(dict(zip(kind.parameters, values, strict=True)), CIRCUMSTANCES)
        for name, array in _outcome(made, signals).items():
            _require(bool(np.isfinite(array).all()), f"{name} is not finite at {made}")
        _require(bool(made.says()), f"its sentence is empty at {made}")


def _corners(kind: Kind) -> Iterator[tuple[float, ...]]:
    """Yield all corners of its bounds; of many parameters only those of all low and all high ends, and random ones."""
    bounds = np.array([(p.low, p.high) for p in kind.parameters.values()])
    if len(bounds) <= _MOST_TOGETHER:
        yield from itertools.product(*bounds.tolist())
        return
    ends = np.random.default_rng(0).integers(0, 2, (2**_MOST_TOGETHER, len(bounds)))
    ends[0], ends[1] = 0, 1
    for some in ends:
        yield tuple(bounds[np.arange(len(bounds)), some].tolist())


def counts_its_time_from_the_start(kind: Kind) -> None:
    """It counts its time from the start of the recording."""
    values = _plain(kind)
    ideal = _outcome(kind.make(values, CIRCUMSTANCES), sampled())
    later = replace(sampled(), time_s=sampled().time_s + 1000.0137)
    moved = _outcome(kind.make(values, {**CIRCUMSTANCES, "start_s": 1000.0137}), later)
    for name in set(moved) - {"time_s"}:
        shift = 1000.0137 if name == "gyro_time_s" else 0.0
        np.testing.assert_allclose(moved[name] - shift, ideal[name], rtol=1e-9, atol=1e-9, err_msg=name)


def writes_to_nothing_that_it_was_given(kind: Kind) -> None:
    """It does not modify the signals that it was given."""
    signals = at(sampled().time_s.copy(), 1.0 / COARSE_HZ)
    for array in arrays(signals).values():
        array.setflags(write=True)
    before = {name: array.copy() for name, array in arrays(signals).items()}
    kind.make(_plain(kind), CIRCUMSTANCES).apply(signals)
    for name, array in arrays(signals).items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)


PROMISES: tuple[Promise, ...] = (
    says_a_sentence_with_numbers,
    is_gone_at_its_zero,
    grows_in_proportion_to_its_sizes,
    says_the_same_at_sixteen_times_the_rate,
    filters_as_its_response_says,
    forgets_within_its_memory,
    is_the_same_in_chunks,
    may_be_given_stretches_together_where_it_says_so,
    is_finite_at_its_bounds,
    counts_its_time_from_the_start,
    writes_to_nothing_that_it_was_given,
)
"""All promises; one that does not concern an effect always holds for it."""


def _with_time_lost() -> Signals:
    """Return two segments with a pause between them."""
    time_s = sampled().time_s.copy()
    time_s[_LOST_AT:] += _LOST_S
    return replace(sampled(), time_s=time_s)


def _reversed(signals: Signals) -> Signals:
    """Return the samples in reverse order, which does not affect a pointwise effect."""
    turned = {name: array[::-1] for name, array in arrays(signals).items()}
    auxiliary = {name: array[::-1] for name, array in signals.auxiliary.items()}
    return replace(signals, **turned, auxiliary=auxiliary)  # type: ignore[arg-type]  # every field turned is an array


def _is_drawn(kind: Kind) -> bool:
    return issubclass(kind, NoiseEffect)


def _require(holds: bool | np.bool_, broken: str) -> None:
    if not holds:
        raise AssertionError(broken)


def _combinations(kind: Kind) -> list[dict[str, float]]:
    """Return every combination of values at which a search begins."""
    scans = [parameter.scan for parameter in kind.parameters.values()]
    return [dict(zip(kind.parameters, values, strict=True)) for values in itertools.product(*scans)]


def _plain(kind: Kind) -> dict[str, float]:
    """Return the middle of the values at which a search begins."""
    return {name: parameter.scan[len(parameter.scan) // 2] for name, parameter in kind.parameters.items()}


def _outcome(made: PhysicalEffect, signals: Signals) -> dict[str, FloatArray]:
    """Return everything that an effect can change in signals."""
    outcome = arrays(made.apply(signals))
    if isinstance(made, ClockEffect):
        outcome["gyro_time_s"] = made.gyro_time_s(signals.time_s)
    if isinstance(made, EncoderEffect):
        outcome["error_slope"] = made.error_slope(signals.angle_deg)
    return outcome


def _without(signals: Signals) -> dict[str, FloatArray]:
    """Return the outcome without an effect."""
    return {**arrays(signals), "gyro_time_s": signals.time_s, "error_slope": np.zeros_like(signals.time_s)}


def _change(made: PhysicalEffect, signals: Signals) -> FloatArray:
    """Return all changes made by an effect, in one array."""
    ideal = _without(signals)
    return np.concatenate([array - ideal[name] for name, array in _outcome(made, signals).items()])
