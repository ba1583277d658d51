"""The motion and the temperatures of a plan, and the change of the output due to an effect, without noise.

It predicts, before anything is recorded, the gain of a concealed effect: twice the log likelihood that it contributes
after the lab's own parameters are refitted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.signal
from scipy.ndimage import uniform_filter1d

from benchctl.estimation.noise import Slow, Whitener, flicker, walk
from benchctl.plan import ConstantRate, Plan, Sine, Step, ThermalRamp
from benchctl.proof.unit import TrialUnit
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import STAGES, Signals, gyro_baseline, run_chain
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.kinds import ClockEffect, EncoderEffect
from benchctl_instruments.physics.structure_places import SETPOINT_WAY
from benchctl_instruments.physics.structures import Structure

_ARCSEC = 3600.0
_ROOM_C = 23.0
_PAUSE_S = 1.5
"""Pause between two steps, in which the table stops or changes its rate; it is not recorded."""

_SETTLING_S = 0.5
_AVERAGED_S = 0.04
"""Approximate averaging time of a rate that is computed from an encoder's angles."""


@dataclass(frozen=True)
class Planned:
    """A unit's run as planned; `starts` are the indices of the steps' first samples, where the motion jumps."""

    unit: TrialUnit
    signals: Signals
    starts: tuple[int, ...]

    def gain(self, effects: Sequence[PhysicalEffect], drifts: Mapping[str, Mapping[str, float]] | None = None) -> float:
        """Return the joint gain of effects in twice the log likelihood, with the lab's parameters refitted.

        `drifts` holds the parameters of wandering biases, by effect; they hide slow changes.
        """
        change = (self._output(effects) - self._clean)[self._settled]
        whitener = self._whitener(drifts or {})
        white = whitener(change) / (self._noise_v * whitener.innovation)
        basis, _ = np.linalg.qr(np.stack([whitener(column) for column in self._followed.T], axis=1))
        left = white - basis @ (basis.T @ white)
        return float(left @ left)

    @property
    def _noise_v(self) -> float:
        """Standard deviation of a sample's white noise, rounding included."""
        return math.hypot(self.unit.noise_v, self.unit.adc_step_v / math.sqrt(12.0))

    def _whitener(self, drifts: Mapping[str, Mapping[str, float]]) -> Whitener:
        time_s, interval_s = self.signals.time_s[self._settled], self.signals.interval_s
        slow: tuple[Slow, ...] = ()
        if size := drifts.get("bias_random_walk"):
            slow += walk(size["v_per_sqrt_s"] / self._noise_v, interval_s)
        if size := drifts.get("flicker_noise"):
            slow += flicker(size["v_rms_per_decade"] / self._noise_v, interval_s, float(np.ptp(time_s)))
        return Whitener(interval_s=interval_s, weight=np.ones(time_s.size), slow=slow, time_s=time_s)

    @cached_property
    def _settled(self) -> npt.NDArray[np.bool_]:
        """All samples except the beginnings of the steps, where the motion jumps and filters ring; shape (n,)."""
        settled = np.ones(self.signals.time_s.size, np.bool_)
        for start in self.starts:
            settled[start : start + round(_SETTLING_S / self.signals.interval_s)] = False
        return settled

    @cached_property
    def _clean(self) -> FloatArray:
        return self._output(())

    @cached_property
    def _followed(self) -> FloatArray:
        """What changes of the lab's parameters can absorb, shape (rows, p)."""
        belief, rate = self.unit.belief, self.signals.rate_dps[self._settled]
        warmer = self.signals.coil_c[self._settled] - belief.T0_c
        columns = [np.ones_like(rate), rate]
        columns += [rate * warmer ** (k + 1) for k in range(len(belief.k_T))]
        columns += [rate ** (2 * k + 3) for k in range(len(belief.k_omega))]
        return np.column_stack([column / np.abs(column).max() for column in columns])

    def _output(self, effects: Sequence[PhysicalEffect]) -> FloatArray:
        plain = [effect for effect in effects if not isinstance(effect, (ClockEffect, EncoderEffect))]
        baseline = gyro_baseline(self.unit.gyro, self.unit.earth_dps, self.signals.interval_s)
        output = run_chain(self.signals, baseline, plain, STAGES).output_v
        slope = self._slope(output)
        for effect in effects:
            if isinstance(effect, Structure) and effect.acts_on == "encoder":
                error = effect.function_of(self.signals)[0] / _ARCSEC
                false_rate = uniform_filter1d(np.gradient(error, self.signals.interval_s), self._averaged)
                output = output - self.unit.gyro.K0_v_per_dps * false_rate
            elif isinstance(effect, ClockEffect):
                output = output + slope * (effect.gyro_time_s(self.signals.time_s) - self.signals.time_s)
            elif isinstance(effect, EncoderEffect):
                # an encoder with a positive error e reports a rate that is too large by e', so the gyro seems to
                # respond too little
                error = effect.error_deg(self.signals.angle_deg)
                false_rate = uniform_filter1d(self._slope(error), self._averaged)
                output = output - self.unit.gyro.K0_v_per_dps * false_rate
        return output

    @property
    def _averaged(self) -> int:
        """Number of samples over which a rate is computed from an encoder's angles."""
        return round(_AVERAGED_S / self.signals.interval_s)

    def _slope(self, values: FloatArray) -> FloatArray:
        """Return the time derivative inside the steps, zero where a step begins."""
        slope = np.gradient(values, self.signals.interval_s)
        starts = np.array(self.starts[1:], dtype=np.int64)
        slope[starts] = slope[starts - 1] = 0.0
        return slope


def planned(plan: Plan, unit: TrialUnit) -> Planned:
    """Return the run of a plan by a unit."""
    interval_s = 1.0 / unit.sample_rate_hz
    parts, now_s, angle_deg = [], 0.0, unit.start_angle_deg
    for step in plan.steps:
        time_s = np.arange(0.0, step.streamed_s, interval_s)
        angle, rate, acceleration = _motion(step, time_s)
        parts.append((now_s + time_s, angle_deg + angle, rate, acceleration))
        now_s += step.streamed_s + _PAUSE_S
        angle_deg = float(parts[-1][1][-1])
    time_s, angle, rate, acceleration = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    housing, slope = _housing(plan, unit, time_s)
    signals = Signals(
        interval_s=interval_s,
        time_s=time_s,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=acceleration,
        housing_c=housing,
        coil_c=housing,
        sensed_rate_dps=rate,
        output_v=np.zeros_like(time_s),
        encoder_deg=angle,
        thermistor_c=housing,
        coil_rate_c_per_s=slope,
        auxiliary={SETPOINT_WAY: _way(plan, time_s)},
    )
    starts = np.cumsum([0, *(part[0].size for part in parts[:-1])])
    return Planned(unit=unit, signals=signals, starts=tuple(starts.tolist()))


def _motion(step: Step, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the angle since the step's beginning [deg], the rate and the acceleration, each of shape (n,)."""
    match step:
        case ConstantRate():
            return step.rate_dps * time_s, np.full_like(time_s, step.rate_dps), np.zeros_like(time_s)
        case Sine():
            return _swing(step.amplitude_dps, step.frequency_hz, time_s)
        case ThermalRamp() if step.swing_dps:
            return _swing(step.swing_dps, step.swing_hz, time_s)
        case _:
            return np.zeros_like(time_s), np.zeros_like(time_s), np.zeros_like(time_s)


def _swing(peak_dps: float, frequency_hz: float, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    omega = 2.0 * np.pi * frequency_hz
    sine, cosine = np.sin(omega * time_s), np.cos(omega * time_s)
    return peak_dps / omega * sine, peak_dps * cosine, -peak_dps * omega * sine


def _housing(plan: Plan, unit: TrialUnit, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the housing's temperature [°C] and its rate of change [°C/s] at the given times, shape (n,)."""
    second = np.arange(0.0, time_s[-1] + 2.0)
    corners = list(_corners(plan))
    setpoint_c = np.interp(second, [at for at, _ in corners], [celsius for _, celsius in corners])
    air = _lagged(setpoint_c, unit.air_lag_s)
    housing = _lagged(air, unit.housing_lag_s)
    return np.interp(time_s, second, housing), np.interp(time_s, second, (air - housing) / unit.housing_lag_s)


def _way(plan: Plan, time_s: FloatArray) -> FloatArray:
    """Return the direction in which the set point moves (−1, 0 or 1), shape (n,)."""
    corners = list(_corners(plan))
    setpoint_c = np.interp(time_s, [at for at, _ in corners], [celsius for _, celsius in corners])
    return np.sign(np.gradient(setpoint_c, time_s).round(9))


def _corners(plan: Plan) -> Iterator[tuple[float, float]]:
    """Yield the corners of the set point: time [s], temperature [°C]."""
    ramps = [step for step in plan.steps if isinstance(step, ThermalRamp)]
    now_s = 0.0
    yield now_s, ramps[0].from_c if ramps else _ROOM_C
    for step in plan.steps:
        if isinstance(step, ThermalRamp):
            yield now_s, step.from_c
            yield now_s + step.streamed_s, step.to_c
        now_s += step.streamed_s + _PAUSE_S


def _lagged(x: FloatArray, tau_s: float) -> FloatArray:
    """Filter by a first-order lag; one sample per second."""
    share = -np.expm1(-1.0 / tau_s)
    y: FloatArray = scipy.signal.lfilter([share], [1.0, share - 1.0], x - x[0]) + x[0]
    return y
