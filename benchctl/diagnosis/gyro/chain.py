"""Prediction of the gyro's output for a recording: from the encoder's motion to the volts of the lab's model.

    U = U0 + K0·k(T)·k(ω)·ω,    k(T) = 1 + a1·(T − T0) + …,    k(ω) = 1 + b2·ω² + b4·ω⁴ + …

and any effects at their stages. The coil senses the Earth's rate in addition to the table's, and U0 is the output at
rest; if k(ω) is not constant or small rates are not sensed, U0 is not only a bias. Motion and linear filters are
band-limited, so a filter is computed as a product in the frequency domain and a time shift by a quintic spline.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from benchctl.diagnosis.gyro.filtering import Filters, spline_at
from benchctl.diagnosis.gyro.frame import Frame
from benchctl.diagnosis.gyro.stacked import Stacked, stacked
from benchctl.side_by_side import do_all, parts_of
from benchctl.signals.blocks import in_cache
from benchctl.signals.motion import rates_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import STAGES, Signals, Stage
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.kinds import ClockEffect, EncoderEffect, FilterEffect
from benchctl_instruments.physics.response_gyro import scaled_v
from benchctl_instruments.physics.structure_places import OVER
from benchctl_instruments.physics.structures import Structure

_KEPT = 2
"""Number of cached results per stage: the common starting point and the latest request."""

_ARCSEC = 3600.0
_PART = 1 << 18
"""Number of rows per thread."""

_COARSE_ORDER = 8.0
"""Encoder errors with more periods per turn are attenuated by the rate filter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """The terms of the lab's model. The parameters are K0, U0, then those of k(T), then those of k(ω)."""

    T0_c: float
    temperature_terms: int
    rate_terms: int

    @classmethod
    def of(cls, simulation: Mapping[str, Any]) -> Self:
        """Return the terms of a model with the names of the open recording."""
        return cls(
            T0_c=float(simulation["T0_c"]),
            temperature_terms=len(simulation["k_T"]),
            rate_terms=len(simulation["k_omega"]),
        )

    def volts(self, baseline: FloatArray, rate_dps: FloatArray, coil_c: FloatArray) -> FloatArray:
        """Return K0·k(T)·k(ω)·ω, shape (n,)."""
        K0, _, *terms = baseline.tolist()
        k_T, k_omega = terms[: self.temperature_terms], terms[self.temperature_terms :]
        volts = np.empty_like(rate_dps)

        def fill(part: slice) -> None:
            for rows in in_cache(part):
                volts[rows] = scaled_v(K0, k_T, k_omega, rate_dps[rows], coil_c[rows] - self.T0_c)

        do_all(fill, parts_of(volts.size, -(-volts.size // _PART)))
        return volts


@dataclass
class GyroChain:
    """Predicts the gyro's output for a frame and caches the results of the stages for later calls.

    `earth_dps` is the Earth's rate about the table's axis, 0 to ignore it. `fast_dps` (n,) is the rate sensed by the
    gyro above the bandwidth of the encoder's rate. The methods are thread-safe.
    """

    frame: Frame
    law: Law
    earth_dps: float = 0.0
    fast_dps: FloatArray | None = None
    _volts: dict[Hashable, Signals] = field(default_factory=dict)
    _kept: dict[str, dict[Hashable, Signals]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def predict(self, baseline: FloatArray, effects: Sequence[PhysicalEffect]) -> FloatArray:
        """Return the volts (n,) for K0, U0, … of shape (p,) and effects, which act in the order of their stages.

        The array is read-only because it may be a cached result.
        """
        request = _Request(
            baseline=baseline,
            moving=tuple(effect for effect in effects if _is_of_motion(effect)),
            others=tuple(effect for effect in effects if not _is_of_motion(effect)),
        )
        signals = self._through("sampling", self._biased(request), request.others)
        volts = self._stacked[0].sampled(signals.output_v).view()
        volts.flags.writeable = False
        return volts

    def forget(self) -> None:
        """Clear the cache."""
        with self._lock:
            self._volts.clear()
            self._kept.clear()
            self.__dict__.pop("_filters", None)

    @cached_property
    def _stacked(self) -> tuple[Stacked, Signals]:
        return stacked(self.frame)

    @cached_property
    def _filters(self) -> Filters:
        return Filters([part.rows for part in self._stacked[0].stretches], self.frame.interval_s)

    def _biased(self, request: _Request) -> Signals:
        """Return the signals before the sampling. A stage without effects returns its input."""

        def with_bias() -> Signals:
            bias_v = request.baseline[1] - request.baseline[0] * self.earth_dps
            scaled = self._scaled(request)
            return replace(scaled, output_v=scaled.output_v + bias_v)

        values = tuple(request.baseline.tolist())
        signals = self._remembered("U0", (request.until("scale"), values), with_bias)
        for stage in ("bias", "electronics"):
            signals = self._after(stage, request, signals, values)
        return signals

    def _scaled(self, request: _Request) -> Signals:
        """Return the volts of the law without the bias, with the effects of the scale stage."""
        K0, _, *terms = request.baseline.tolist()
        values = (K0, *terms)

        def rated() -> Signals:
            warm = self._warmed(request)
            return replace(warm, output_v=self.law.volts(request.baseline, warm.sensed_rate_dps, warm.coil_c))

        signals = self._remembered_in(self._volts, (request.until("coil_temperature"), values), rated)
        return self._after("scale", request, signals, values)

    def _warmed(self, request: _Request) -> Signals:
        """Return the signals with the rate and the temperature of the coil."""

        def with_earth() -> Signals:
            signals = self._remembered("table", request.moving, lambda: self._moved(request.moving))
            signals = self._after("motion", request, signals)
            return replace(signals, sensed_rate_dps=signals.sensed_rate_dps + self.earth_dps)

        signals = self._remembered("Earth", request.until("motion"), with_earth)
        return self._heated(request, self._after("sensed_rate", request, signals))

    def _heated(self, request: _Request, signals: Signals) -> Signals:
        """Return the signals with the coil temperature under its effects; the motion has no influence on it."""
        own = tuple(effect for effect in request.others if effect.stage == "coil_temperature")
        if not own:
            return signals

        def heated() -> Signals:
            of_table = self._remembered("table", request.clocks, lambda: self._moved(request.clocks))
            return self._through("coil_temperature", of_table, own)

        warm = self._remembered("coil_temperature", (request.clocks, own), heated)
        return replace(signals, coil_c=warm.coil_c, coil_rate_c_per_s=warm.coil_rate_c_per_s)

    def _after(self, stage: Stage, request: _Request, signals: Signals, values: tuple[float, ...] = ()) -> Signals:
        """Apply the effects of a stage to signals that depend on these `values` of the baseline."""
        own = [effect for effect in request.others if effect.stage == stage]
        if not own:
            return signals
        return self._remembered(stage, (request.until(stage), values), lambda: self._through(stage, signals, own))

    def _remembered(self, name: str, key: Hashable, make: Callable[[], Signals]) -> Signals:
        return self._remembered_in(self._kept.setdefault(name, {}), key, make)

    def _remembered_in(self, kept: dict[Hashable, Signals], key: Hashable, make: Callable[[], Signals]) -> Signals:
        with self._lock:
            found = kept.pop(key, None)
            if found is not None:
                kept[key] = found  # as the latest entry
                return found
        found = make()
        with self._lock:
            kept[key] = found
            while len(kept) > _KEPT:
                kept.pop(next(iter(kept)))
        return found

    def _through(self, stage: Stage, signals: Signals, effects: Sequence[PhysicalEffect]) -> Signals:
        """Apply the effects of a stage one after the other."""
        stack = self._stacked[0]
        for effect in effects:
            if effect.stage != stage:
                continue
            if isinstance(effect, FilterEffect):
                values = self._filters(getattr(signals, effect.filtered), effect)
                signals = _with(signals, {effect.filtered: values})
            elif effect.pointwise or (effect.timeless and stack.is_one_recording):
                signals = effect.apply(replace(signals, memory={}))
            elif isinstance(effect, Structure) and effect.shape == "memory":
                followed = stack.lagged(OVER[effect.over].values(signals), signals.time_s, effect.values["tau"])
                signals = effect.changed(signals, effect.value_at(followed))
            else:
                signals = stack.each(signals, effect.apply)
        return signals

    def _moved(self, effects: Sequence[PhysicalEffect]) -> Signals:
        """Return the motion at the instants of the gyro's samples, corrected for encoder errors."""
        signals = self._stacked[1]
        for effect in effects:
            if isinstance(effect, EncoderEffect):
                signals = self._corrected(signals, effect)
            elif isinstance(effect, Structure):
                error_deg = self._stacked[0].sampled(effect.function_of(signals)[0]) / _ARCSEC
                signals = self._without_error(signals, error_deg)
        for effect in effects:
            if isinstance(effect, ClockEffect):
                signals = self._shifted(signals, effect)
        if self.fast_dps is None:
            return signals
        sensed, samples = signals.sensed_rate_dps.copy(), self._stacked[0].samples
        sensed[slice(None) if samples is None else samples] += self.fast_dps
        return replace(signals, sensed_rate_dps=sensed)

    def _corrected(self, signals: Signals, effect: EncoderEffect) -> Signals:
        frame = self.frame
        # errors at the orders of the ripple were not filtered
        if effect.waves_a_turn <= _COARSE_ORDER or effect.waves_a_turn in frame.motions[0].ripple.orders:
            return effect.true_motion(signals)
        # finer than the rate filter resolves: the error is subtracted before it
        stated = frame.encoder_deg
        return self._without_error(signals, effect.error_deg(stated - effect.error_deg(stated)))

    def _without_error(self, signals: Signals, error_deg: FloatArray) -> Signals:
        """Return the signals without the filtered rate of an encoder error, shape (n,)."""
        frame = self.frame
        rate = signals.rate_dps.copy()
        wrong = rates_of(frame.motions, [error_deg[rows] for rows in frame.stretches])
        for part in self._stacked[0].stretches:
            rate[part.rows] -= wrong[part.stretch]
        return replace(signals, rate_dps=rate, sensed_rate_dps=rate)

    def _shifted(self, signals: Signals, effect: ClockEffect) -> Signals:
        shift_s = effect.gyro_time_s(signals.time_s) - signals.time_s
        shifted = {name: getattr(signals, name).copy() for name in ("angle_deg", "rate_dps", "acceleration_dps2")}
        temp = signals.coil_c.copy()
        for part in self._stacked[0].stretches:
            rows = part.rows
            place = np.arange(rows.stop - rows.start) + shift_s[rows] / part.interval_s
            for values in shifted.values():
                values[rows] = spline_at(values[rows], place)
            temp[rows] += signals.coil_rate_c_per_s[rows] * shift_s[rows]
        return _with(signals, {**shifted, "sensed_rate_dps": shifted["rate_dps"], "housing_c": temp, "coil_c": temp})


def _is_of_motion(effect: PhysicalEffect) -> bool:
    """Return whether an effect changes the recorded motion."""
    of_encoder = isinstance(effect, Structure) and effect.acts_on == "encoder"
    return of_encoder or isinstance(effect, (ClockEffect, EncoderEffect))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Request:
    """A request: parameters (p,), effects that change the recorded motion, and the other effects."""

    baseline: FloatArray
    moving: tuple[PhysicalEffect, ...]
    others: tuple[PhysicalEffect, ...]

    @property
    def clocks(self) -> tuple[PhysicalEffect, ...]:
        """The effects that change the sampling instants."""
        return tuple(effect for effect in self.moving if isinstance(effect, ClockEffect))

    def until(self, stage: Stage) -> tuple[PhysicalEffect, ...]:
        """Return all effects up to and including a stage."""
        last = STAGES.index(stage)
        return (*self.moving, *(effect for effect in self.others if STAGES.index(effect.stage) <= last))


def _with(signals: Signals, changed: dict[str, Any]) -> Signals:
    return replace(signals, **changed)
