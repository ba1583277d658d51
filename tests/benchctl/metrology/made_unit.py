"""A gyro of known values on a bench of known errors, recorded in memory: shares no physics with the product.

U = gain·[K(T, turn-on)·(1 + hysteresis)·f(ω) + U0 + bias(T, dT/dt, turn-on, warm-up, where the chamber came from)] + …
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchctl.plan import ConstantRate, Mount, PowerCycle, Sine, Soak, Static, Step, ThermalRamp
from benchctl.recordings.model import BenchFacts, Meta, StepInfo, Unit
from benchctl.recordings.model import Step as Recorded
from benchctl.recordings.reader import Recording, StepsInMemory

EARTH_DPS = 15.041 / 3600.0
ROOM_C = 20.0
ACCURACY_ARCSEC, LATITUDE_DEG = 3.0, 58.5


@dataclass(frozen=True, kw_only=True)
class MadeUnit:
    """True values; rates in deg/s, volts, °C, seconds."""

    K_v_per_dps: float = 0.05
    U0_v: float = 0.012
    cubic_per_dps2: float = 3e-7
    asymmetry: float = 400e-6
    hysteresis: float = 60e-6
    top_dps: float = 100.0
    scale_per_c: float = -150e-6
    bias_v_per_c: float = 3e-5
    bias_v_per_c2: float = -1e-7
    shupe_v_s_per_c: float = 0.02
    thermal_scale: float = 120e-6
    thermal_bias_v: float = 4e-4
    turn_on_scale: float = 200e-6
    turn_on_bias_v: float = 4e-4
    warm_up_v: float = 3e-3
    warm_up_tau_s: float = 150.0
    dead_dps: float = 0.015
    misalignment_rad: float = 3e-3
    cutoff_hz: float = 2.0
    delay_s: float = 0.004
    white_v_per_sqrt_hz: float = 2.5e-5
    walk_v_per_sqrt_s: float = 5e-7
    sample_rate_hz: float = 50.0
    adc_bits: int = 16

    def straight(self, rate_dps: np.ndarray) -> np.ndarray:
        """The law at room temperature, in deg/s: dead zone, curvature, asymmetry."""
        rate = np.sign(rate_dps) * np.maximum(np.abs(rate_dps) - self.dead_dps, 0.0)
        return rate * (1.0 - self.cubic_per_dps2 * rate**2) + 0.5 * self.asymmetry * np.abs(rate)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """What the instruments get wrong, drawn from the figures that a recording without certificates is taken to have.

    Those of the thermometer and the encoder are deviations: they err anew at every temperature, at every angle.
    """

    gain: float = 0.0
    offset_v: float = 0.0
    clock: float = 0.0
    thermometer_c: float = 0.0
    mounting_rad: float = 0.0
    fixture_rad: float = 0.0
    latitude_deg: float = LATITUDE_DEG
    encoder_arcsec: float = 0.0

    @staticmethod
    def drawn(random: np.random.Generator) -> Errors:
        """One bench."""
        step_v = 20.0 / 2**16
        tilt_deg, latitude_deg = random.normal(0.0, 0.1, 2)
        return Errors(
            gain=random.normal(0.0, 50e-6),
            offset_v=random.uniform(-step_v / 2, step_v / 2),
            clock=random.normal(0.0, 20e-6),
            thermometer_c=0.1,
            mounting_rad=np.deg2rad(random.normal(0.0, 0.1)),
            fixture_rad=np.deg2rad(random.normal(0.0, 0.1)),
            latitude_deg=LATITUDE_DEG + latitude_deg + tilt_deg,
            encoder_arcsec=ACCURACY_ARCSEC / np.sqrt(3.0),
        )


@dataclass(kw_only=True)
class Made:
    """A recording in the making: what is remembered from step to step."""

    unit: MadeUnit
    errors: Errors
    random: np.random.Generator
    now_s: float = 0.0
    on_s: float = -1e6
    celsius: float = ROOM_C
    thermometer_c: float = 0.0
    from_colder: int = 0
    across: bool = False
    walk_v: float = 0.0
    scale: float = 0.0
    bias_v: float = 0.0
    turn_ons: list[tuple[float, float]] = field(default_factory=list)
    walked_v: float | None = None
    """How far the bias had walked when the first rate began."""
    _before: dict[bool, float] = field(default_factory=dict)

    def record(self, steps: Sequence[Step]) -> Recording:
        """The recording of these steps."""
        self.thermometer_c = self.random.normal(0.0, self.errors.thermometer_c)
        made = [self._step(index, step) for index, step in enumerate(steps, 1)]
        meta = Meta(
            status="complete",
            unit=Unit(serial="MADE-1", range_dps=self.unit.top_dps),
            bench=BenchFacts(
                sample_rate_hz=self.unit.sample_rate_hz,
                encoder_accuracy_arcsec=ACCURACY_ARCSEC,
                adc_bits=self.unit.adc_bits,
                adc_range_v=10.0,
                latitude_deg=LATITUDE_DEG,
            ),
        )
        return Recording(Path("made"), meta, [step.info for step in made], StepsInMemory(made), digest="made")

    def _step(self, index: int, step: Step) -> Recorded:
        start_s = self.now_s
        channels: dict[str, np.ndarray] = {}
        if isinstance(step, Soak | PowerCycle | Mount):
            self._before = {}
        if isinstance(step, Soak):
            if step.setpoint_c != self.celsius:
                self.from_colder = 1 if step.setpoint_c > self.celsius else -1
                self.thermometer_c = self.random.normal(0.0, self.errors.thermometer_c)
            self.celsius = step.setpoint_c
            self._pass(step.hold_s)
        elif isinstance(step, PowerCycle):
            self._pass(step.off_s)
            self.on_s = self.now_s
            self.scale = self.random.normal(0.0, self.unit.turn_on_scale)
            self.bias_v = self.random.normal(0.0, self.unit.turn_on_bias_v)
            self.turn_ons.append((self.scale, self.bias_v))
        elif isinstance(step, Mount):
            self.across = step.position == "across"
            self._pass(120.0)
        else:
            channels = self._streamed(step)
        info = StepInfo(
            index=index,
            name=step.label,
            kind=step.kind,
            role="none" if not channels else "fit",
            t_start=start_s,
            t_end=self.now_s,
            chamber_setpoint_c=self.celsius,
            rate_dps=getattr(step, "rate_dps", None),
            amplitude_dps=getattr(step, "amplitude_dps", None),
            frequency_hz=getattr(step, "frequency_hz", None),
            samples=len(channels.get("time_s", ())),
            mounting="across" if self.across else "",
        )
        return Recorded(info, channels)

    def _pass(self, seconds: float) -> None:
        self.now_s += seconds
        self.walk_v += self.random.normal(0.0, self.unit.walk_v_per_sqrt_s * np.sqrt(seconds))

    def _streamed(self, step: Static | ConstantRate | Sine | ThermalRamp) -> dict[str, np.ndarray]:
        unit, errors = self.unit, self.errors
        self._pass(getattr(step, "settle_s", 2.0))
        interval_s = 1.0 / unit.sample_rate_hz
        own_s = np.arange(int(step.streamed_s * unit.sample_rate_hz)) * interval_s
        time_s, celsius = self.now_s + own_s, np.full(own_s.size, self.celsius)
        per_s = np.zeros(own_s.size)
        if isinstance(step, ThermalRamp):
            slope = np.sign(step.to_c - step.from_c) * step.ramp_c_per_min / 60.0
            celsius, per_s = step.from_c + slope * own_s, np.full(own_s.size, slope)
        if isinstance(step, ConstantRate) and self.walked_v is None:
            self.walked_v = self.walk_v
        angle_deg, felt_dps = self._motion(step, own_s)
        steps_v = self.random.normal(0.0, unit.walk_v_per_sqrt_s * np.sqrt(interval_s), own_s.size)
        walk_v = self.walk_v + np.cumsum(steps_v)
        warm = celsius - ROOM_C
        scale = 1.0 + self.scale + unit.scale_per_c * warm + 0.5 * self.from_colder * unit.thermal_scale
        bias_v = (
            unit.U0_v
            + self.bias_v
            + unit.bias_v_per_c * warm
            + unit.bias_v_per_c2 * warm**2
            + unit.shupe_v_s_per_c * per_s
            + unit.warm_up_v * np.exp(-(time_s - self.on_s) / unit.warm_up_tau_s)
            + 0.5 * self.from_colder * unit.thermal_bias_v
        )
        white = self.random.normal(0.0, unit.white_v_per_sqrt_hz * np.sqrt(unit.sample_rate_hz), own_s.size)
        output_v = unit.K_v_per_dps * scale * felt_dps + bias_v + walk_v + white
        self.walk_v, self.now_s = float(walk_v[-1]), float(time_s[-1] + interval_s)
        if isinstance(step, ThermalRamp):
            self.celsius = step.to_c
        return {
            "time_s": time_s[0] + own_s * (1.0 + errors.clock),
            "encoder_deg": np.mod(angle_deg, 360.0),
            "gyro_v": output_v * (1.0 + errors.gain) + errors.offset_v,
            "gyro_temp_c": celsius + self.thermometer_c + self.random.normal(0.0, 0.005, own_s.size),
        }

    def _motion(self, step: Step, own_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angles as the encoder states them, and what the law makes of the rate, in deg/s."""
        unit, errors = self.unit, self.errors
        if isinstance(step, Sine):
            omega = 2.0 * np.pi * step.frequency_hz
            angle_deg = 40.0 + step.amplitude_dps / omega * np.sin(omega * own_s)
            once = np.arange(256) / 256.0
            harmonics = np.fft.rfft(unit.straight(step.amplitude_dps * np.cos(2.0 * np.pi * once))) / 128.0
            felt_dps = np.full(own_s.size, harmonics[0].real / 2.0)
            for n in range(1, 12):
                response = np.exp(-1j * n * omega * unit.delay_s) / (1.0 + 1j * n * step.frequency_hz / unit.cutoff_hz)
                felt_dps += (harmonics[n] * response * np.exp(1j * n * omega * own_s)).real
            return angle_deg, felt_dps
        rate_dps = step.rate_dps if isinstance(step, ConstantRate) else 0.0
        earth_dps = EARTH_DPS * np.sin(np.deg2rad(errors.latitude_deg))
        along = np.cos(errors.mounting_rad)
        if self.across:
            along, earth_dps = np.sin(unit.misalignment_rad + errors.fixture_rad), 0.0
        felt_dps = float(unit.straight(np.array([rate_dps * along + earth_dps]))[0])
        forward, size = rate_dps > 0.0, abs(rate_dps)
        if rate_dps and not self.across:
            leg = -1.0 if self._before.get(forward, 0.0) > size + 1e-6 else 1.0
            share = 1.0 - (size / unit.top_dps) ** 2
            felt_dps += 0.5 * leg * unit.hysteresis * unit.top_dps * share
            self._before[forward] = size
        slope_dps = 0.0
        if rate_dps:
            both = self.random.normal(0.0, errors.encoder_arcsec / 3600.0, 2) if errors.encoder_arcsec else np.zeros(2)
            slope_dps = float(np.diff(both)[0]) / own_s[-1]
        return (rate_dps + slope_dps) * own_s + 40.0, np.full(own_s.size, felt_dps)


def recorded(steps: Sequence[Step], unit: MadeUnit, seed: int, *, errors: bool = True) -> tuple[Recording, Made]:
    """A recording of steps, and who made it."""
    random = np.random.default_rng(seed)
    made = Made(unit=unit, errors=Errors.drawn(random) if errors else Errors(), random=random)
    return made.record(steps), made
