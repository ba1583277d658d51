"""The gyro's chain on the samples of a recording: from the encoder's motion to the volts that the lab's model predicts.

    U = U0 + K0·k(T)·k(ω)·ω,    k(T) = 1 + a1·(T − T0) + …,    k(ω) = 1 + b2·ω² + b4·ω⁴ + …

and any effects at their stages. The coil feels the Earth's rate beside the table's, and U0 is what it puts out at rest:
where k(ω) bends, or small rates are not felt, that is more than a bias. Motion and linear filters are band-limited, so
that a filter is exact as a product in frequency, and a shift in time as a spline of fifth degree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.fft
from scipy.ndimage import map_coordinates, spline_filter1d

from benchctl.diagnosis.gyro.frame import Frame
from instruments.physics.chain import Signals, Stage
from instruments.physics.effects.effect import PhysicalEffect
from instruments.physics.effects.kinds import ClockEffect, EncoderEffect, FilterEffect
from instruments.physics.response_gyro import scaled_v

FloatArray = npt.NDArray[np.float64]

_KEPT = 6
_KEPT_VOLTS = 3
_TURNED_ROWS = 64
_DEGREE = 5
_PAUSE = -1
"""The first index of what is no stretch of samples, but what was known in between."""

_COARSE_ORDER = 8.0
"""Errors of an encoder that change faster than so often a turn do not pass the filter of the rate as they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """Which terms the lab's model has: parameters are K0, U0, then those of k(T), then those of k(ω)."""

    T0_c: float
    temperature_terms: int
    rate_terms: int

    def volts(self, baseline: FloatArray, rate_dps: FloatArray, coil_c: FloatArray) -> FloatArray:
        """K0·k(T)·k(ω)·ω, shape (n,)."""
        K0, _, *terms = baseline.tolist()
        k_T, k_omega = terms[: self.temperature_terms], terms[self.temperature_terms :]
        return scaled_v(K0, k_T, k_omega, rate_dps, coil_c - self.T0_c)


@dataclass(slots=True)
class GyroChain:
    """Predicts the gyro's output for a frame; what effects of the same early stages share is kept for the next call.

    `earth_dps` is the Earth's rate about the table's axis, 0 to leave it out.
    """

    frame: Frame
    law: Law
    earth_dps: float = 0.0
    _volts: dict[tuple[float, ...], tuple[list[Signals], list[Signals]]] = field(default_factory=dict)
    _kept: dict[str, dict[tuple[PhysicalEffect, ...], list[Signals]]] = field(default_factory=dict)

    def predict(self, baseline: FloatArray, effects: Sequence[PhysicalEffect]) -> FloatArray:
        """Volts of shape (n,) for K0, U0, … of shape (p,) and effects, which act in the order of their stages."""
        scaled = self._stage(self._scaled(baseline, effects), "scale", effects)
        bias_v = baseline[1] - baseline[0] * self.earth_dps
        biased = [replace(part, output_v=part.output_v + bias_v) for part in scaled]
        for stage in ("bias", "electronics", "sampling"):
            biased = self._stage(biased, stage, effects)
        return np.concatenate([part.output_v for part in biased if not _is_pause(part)])

    def _scaled(self, baseline: FloatArray, effects: Sequence[PhysicalEffect]) -> list[Signals]:
        """The law's volts, without the bias."""
        parts = self._coil(effects)
        values = tuple(baseline.tolist())
        key = (id(parts), values[0], *values[2:])
        found = self._volts.get(key)
        if found is None or found[0] is not parts:
            rated = [self.law.volts(baseline, part.sensed_rate_dps, part.coil_c) for part in parts]
            found = parts, [replace(part, output_v=volts) for part, volts in zip(parts, rated, strict=True)]
            self._volts[key] = found
            while len(self._volts) > _KEPT_VOLTS:
                self._volts.pop(next(iter(self._volts)), None)
        return found[1]

    def _coil(self, effects: Sequence[PhysicalEffect]) -> list[Signals]:
        early = tuple(effect for effect in effects if effect.stage in ("motion", "sensed_rate", "coil_temperature"))
        moving = tuple(effect for effect in effects if isinstance(effect, (ClockEffect, EncoderEffect)))
        return self._remembered("coil", (*moving, *early), lambda: self._warmed(early, moving))

    def _warmed(self, early: Sequence[PhysicalEffect], moving: Sequence[PhysicalEffect]) -> list[Signals]:
        sensing = tuple(effect for effect in early if effect.stage != "coil_temperature")

        def sensed() -> list[Signals]:
            parts = self._remembered("motion", moving, lambda: self._moved(moving))
            parts = self._stage(parts, "motion", sensing)
            if self.earth_dps:
                parts = [replace(one, sensed_rate_dps=one.sensed_rate_dps + self.earth_dps) for one in parts]
            return self._stage(parts, "sensed_rate", sensing)

        parts = self._remembered("sensed", (*moving, *sensing), sensed)
        return self._stage(parts, "coil_temperature", early)

    def _remembered(self, name: str, key: Sequence[PhysicalEffect], make: Callable[[], list[Signals]]) -> list[Signals]:
        kept = self._kept.setdefault(name, {})
        found = kept.get(tuple(key))
        if found is None:
            found = make()
            kept[tuple(key)] = found
            while len(kept) > _KEPT:
                kept.pop(next(iter(kept)), None)
        return found

    def _stage(self, parts: list[Signals], stage: Stage, effects: Sequence[PhysicalEffect]) -> list[Signals]:
        for effect in effects:
            if effect.stage != stage or isinstance(effect, (ClockEffect, EncoderEffect)):
                continue
            if isinstance(effect, FilterEffect):
                parts = [part if _is_pause(part) else _filtered(part, effect) for part in parts]
                continue
            done: list[Signals] = []
            stretch, origin_s = 0, np.nan
            for part in parts:
                # in another recording all begins anew
                goes_on = self.frame.origins_s[stretch] == origin_s
                done.append(effect.apply(replace(part, memory=done[-1].memory if goes_on else {})))
                origin_s = self.frame.origins_s[stretch]
                stretch += not _is_pause(part)
            parts = done
        return parts

    def _moved(self, effects: Sequence[PhysicalEffect]) -> list[Signals]:
        """Motion at the instants of the gyro's samples, with the encoder's errors taken off."""
        frame = self.frame
        parts = [self._plain(i) for i in range(len(frame.stretches))]
        for effect in effects:
            if isinstance(effect, EncoderEffect):
                parts = [self._corrected(i, part, effect) for i, part in enumerate(parts)]
        for effect in effects:
            if isinstance(effect, ClockEffect):
                parts = [self._shifted(part, effect) for part in parts]
        return [one for i, part in enumerate(parts) for one in (*self._pause(i), part)]

    def _pause(self, stretch: int) -> Iterator[Signals]:
        """What is known of the time before a stretch: the table rests, the thermistor goes its way."""
        pause = self.frame.pauses[stretch] if self.frame.pauses else None
        if pause is None:
            return
        rest = np.zeros_like(pause.time_s)
        yield Signals(
            interval_s=pause.interval_s,
            time_s=pause.time_s - self.frame.origins_s[stretch],
            angle_deg=rest,
            rate_dps=rest,
            acceleration_dps2=rest,
            housing_c=pause.temp_c,
            coil_c=pause.temp_c,
            sensed_rate_dps=rest,
            output_v=rest,
            encoder_deg=rest,
            thermistor_c=pause.temp_c,
            coil_rate_c_per_s=pause.temp_rate_c_per_s,
            first_index=_PAUSE,
            auxiliary=dict.fromkeys(self.frame.auxiliary, rest),
        )

    def _plain(self, stretch: int) -> Signals:
        frame, part = self.frame, self.frame.stretches[stretch]
        angle, rate, temp = frame.angle_deg[part], frame.rate_dps[part], frame.temp_c[part]
        return Signals(
            interval_s=frame.interval_s,
            time_s=frame.time_s[part] - frame.origins_s[stretch],
            angle_deg=angle,
            rate_dps=rate,
            acceleration_dps2=frame.acceleration_dps2[part],
            housing_c=temp,
            coil_c=temp,
            sensed_rate_dps=rate,
            output_v=np.zeros(0),
            encoder_deg=angle,
            thermistor_c=temp,
            coil_rate_c_per_s=frame.temp_rate_c_per_s[part],
            first_index=part.start,
            auxiliary={name: values[part] for name, values in frame.auxiliary.items()},
        )

    def _corrected(self, stretch: int, part: Signals, effect: EncoderEffect) -> Signals:
        # what repeats with the angle like ripple went past the filters
        if effect.waves_a_turn <= _COARSE_ORDER or effect.waves_a_turn in self.frame.motions[stretch].ripple.orders:
            return effect.true_motion(part)
        # finer than the filter of the rate: the error is taken off before it
        stated = self.frame.encoder_deg[self.frame.stretches[stretch]]
        error = effect.error_deg(stated - effect.error_deg(stated))
        rate = part.rate_dps - self.frame.motions[stretch].rate_of(error)
        return replace(part, rate_dps=rate, sensed_rate_dps=rate)

    def _shifted(self, part: Signals, effect: ClockEffect) -> Signals:
        shift_s = effect.gyro_time_s(part.time_s) - part.time_s
        place = np.arange(part.time_s.size) + shift_s / part.interval_s
        names = ("angle_deg", "rate_dps", "acceleration_dps2")
        angle, rate, acceleration = (_spline_at(getattr(part, name), place) for name in names)
        temp = part.coil_c + part.coil_rate_c_per_s * shift_s
        return replace(
            part,
            angle_deg=angle,
            rate_dps=rate,
            acceleration_dps2=acceleration,
            sensed_rate_dps=rate,
            housing_c=temp,
            coil_c=temp,
        )


def _is_pause(part: Signals) -> bool:
    return part.first_index == _PAUSE


def _spline_at(values: FloatArray, place: FloatArray) -> FloatArray:
    """Equidistant values at places between them, shape (n,)."""
    if values.size <= _DEGREE:
        return values
    line = np.linspace(values[0], values[-1], values.size)
    coefficients = spline_filter1d(values - line, _DEGREE, mode="mirror")  # type: ignore[call-overload]  # the stubs know only lists
    between: FloatArray = map_coordinates(  # type: ignore[call-overload]  # the stubs know no list of coordinates
        coefficients, [place], order=_DEGREE, mode="mirror", prefilter=False
    )
    slope = (values[-1] - values[0]) / max(values.size - 1, 1)
    shifted: FloatArray = between + values[0] + slope * place
    return shifted


def _filtered(part: Signals, effect: FilterEffect) -> Signals:
    """A linear filter as a product in frequency."""
    x: FloatArray = getattr(part, effect.filtered)
    padding = int(min(effect.memory_s, 60.0) / part.interval_s) + 2 * _TURNED_ROWS
    long = _endless(x, scipy.fft.next_fast_len(x.size + 2 * padding, real=True))
    gain = effect.response(scipy.fft.rfftfreq(long.size, part.interval_s))
    y = scipy.fft.irfft(scipy.fft.rfft(long) * gain, long.size)[: x.size]
    changed: dict[str, Any] = {effect.filtered: y}
    return replace(part, **changed)


def _endless(x: FloatArray, size: int) -> FloatArray:
    """One period, shape (size,), that begins with x (n,) and comes back to its begin without a jump or a kink.

    Beyond its ends x is turned about them and dies away: a kink there would ring at half the sample rate all along.
    """
    reach = min(_TURNED_ROWS, x.size - 1)
    fading = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, reach + 1) / (reach + 1))
    long = np.empty(size)
    long[: x.size] = x
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, size - x.size))
    long[x.size :] = x[-1] + (x[0] - x[-1]) * ramp
    if reach:
        long[x.size : x.size + reach] += fading * (x[-1] - x[-2 : -2 - reach : -1])
        long[size - reach :] += (fading * (x[0] - x[1 : reach + 1]))[::-1]
    return long
