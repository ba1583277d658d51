"""A light generator of campaigns whose truth is known; it shares nothing with the simulated bench.

Motion is a closed formula, so that the true rate at the delayed instant is exact; every array operation is on a whole
step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit

EARTH_DPS = 15.041 / 3600


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What the gyro and the bench really are."""

    K0: float = 0.050
    U0: float = 0.012
    S: float = 0.0045
    T0: float = 20.0
    g: tuple[float, float] = (-1.315e-4, 2.066e-6)
    c: tuple[float, float] = (2e-5, -1.5e-7)
    delay: float = 1.125e-3
    white: float = 0.5e-3
    walk: float = 5e-7
    eccentricity: tuple[float, float] = (15.0, 5.0)
    phase: tuple[float, float] = (37.0, 211.0)
    counts: int = 360000
    adc_step: float = 20.0 / 65536
    thermistor: float = 0.003
    latitude: float = 58.5
    fs: float = 500.0

    @property
    def earth(self) -> float:
        """Vertical part of the Earth's rate, °/s."""
        return EARTH_DPS * float(np.sin(np.deg2rad(self.latitude)))

    def encoder_terms(self) -> dict[str, float]:
        """The encoder's error as sine and cosine amplitudes, arc seconds."""
        terms = {}
        for order, (amplitude, phase) in enumerate(zip(self.eccentricity, self.phase, strict=True), start=1):
            terms[f"encoder_sin{order}_arcsec"] = amplitude * float(np.cos(np.deg2rad(order * phase)))
            terms[f"encoder_cos{order}_arcsec"] = -amplitude * float(np.sin(np.deg2rad(order * phase)))
        return terms

    def named(self) -> dict[str, float]:
        """The truth under the names of the joint fit's parameters, law `sine`."""
        return {
            "K0_v_per_dps": self.K0,
            "S_rad_per_dps": self.S,
            "g1": self.g[0],
            "g2": self.g[1],
            "U0_v": self.U0,
            "c1": self.c[0],
            "c2": self.c[1],
            "delay_s": self.delay,
            **self.encoder_terms(),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask:
    """One step to be made."""

    kind: str
    temperature: float
    seconds: float
    rate: float = 0.0
    frequency: float = 0.0
    role: str = "fit"


def two_stage(
    *,
    temperatures: tuple[float, ...] = (-40.0, -20.0, 0.0, 20.0, 40.0, 60.0),
    rates: tuple[float, ...] = (20.0, 40.0, 80.0, 120.0, 160.0),
    amplitude: float = 160.0,
    sine_s: float = 24.0,
    static_s: float = 10.0,
    verify: bool = True,
) -> list[Ask]:
    """The paper's campaign in small: sweep at 20 °C, low rates at every temperature, sines at four of them."""
    asks: list[Ask] = []
    for temperature in temperatures:
        asks.append(Ask(kind="static", temperature=temperature, seconds=static_s))
        for rate in rates if temperature == 20.0 else (25.0, 50.0):
            for sign in (1, -1):
                asks.append(
                    Ask(kind="constant_rate", temperature=temperature, rate=sign * rate, seconds=max(4.0, 365.0 / rate))
                )
        asks.append(Ask(kind="static", temperature=temperature, seconds=static_s))
    for temperature in (*temperatures[::2], 20.0):
        for frequency in (0.25, 0.5, 1.0):
            asks.append(Ask(kind="sine", temperature=temperature, rate=amplitude, frequency=frequency, seconds=sine_s))
        if verify:
            asks.append(
                Ask(
                    kind="sine",
                    temperature=temperature,
                    rate=0.97 * amplitude,
                    frequency=0.4,
                    seconds=0.5 * sine_s,
                    role="verify",
                )
            )
    return asks


def meta_of(truth: Truth, **simulation: object) -> Meta:
    """The description of the bench."""
    return Meta(
        status="simulated",
        unit=Unit(serial="synthetic", range_dps=200.0),
        bench=BenchFacts(
            sample_rate_hz=truth.fs,
            encoder_counts_per_rev=truth.counts,
            encoder_accuracy_arcsec=20.0,
            adc_bits=16,
            adc_range_v=10.0,
            latitude_deg=truth.latitude,
        ),
        simulation=simulation or None,
    )


def steps(truth: Truth, asks: list[Ask], seed: int, *, soak_s: float = 5400.0) -> Iterator[Step]:
    """The recorded steps, one after the other; a new temperature takes a soak."""
    rng = np.random.default_rng(seed)
    clock, walk, here, angle = 0.0, 0.0, None, float(rng.uniform(0, 360))
    for index, ask in enumerate(asks, start=1):
        pause = soak_s if ask.temperature != here else 8.0
        here = ask.temperature
        clock += pause
        walk += truth.walk * np.sqrt(pause) * rng.standard_normal()
        n = int(ask.seconds * truth.fs)
        t = np.arange(n) / truth.fs
        position, _ = _motion(ask, t)
        _, felt = _motion(ask, t - truth.delay)
        drift = walk + truth.walk / np.sqrt(truth.fs) * np.cumsum(rng.standard_normal(n))
        output = gyro(truth, felt + truth.earth, np.full(n, ask.temperature)) + drift
        output += truth.white * rng.standard_normal(n)
        if truth.adc_step:
            output = np.round(output / truth.adc_step) * truth.adc_step
        info = StepInfo(
            index=index,
            name=f"{ask.kind} {index}",
            kind=ask.kind,
            role=ask.role,
            t_start=clock,
            t_end=clock + ask.seconds,
            chamber_setpoint_c=ask.temperature,
            rate_dps=ask.rate if ask.kind == "constant_rate" else None,
            amplitude_dps=ask.rate if ask.kind == "sine" else None,
            frequency_hz=ask.frequency if ask.kind == "sine" else None,
            sample_rate_hz=truth.fs,
            samples=n,
        )
        channels = {
            "time_s": clock + t,
            "encoder_deg": encoder(truth, angle + position),
            "gyro_v": output,
            "gyro_temp_c": ask.temperature + truth.thermistor * rng.standard_normal(n),
        }
        yield Step(info, channels)
        clock += ask.seconds
        walk = float(drift[-1])
        angle += float(position[-1])


def gyro(truth: Truth, rate: npt.NDArray[np.float64], temperature: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The open-loop interferometer's output without noise."""
    dt = temperature - truth.T0
    gain = truth.K0 / truth.S * (1 + truth.g[0] * dt + truth.g[1] * dt**2)
    return np.asarray(truth.U0 + truth.c[0] * dt + truth.c[1] * dt**2 + gain * np.sin(truth.S * rate))


def encoder(truth: Truth, angle: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """What the encoder shows, 0 to 360."""
    shown = angle.copy()
    for order, (amplitude, phase) in enumerate(zip(truth.eccentricity, truth.phase, strict=True), start=1):
        shown += amplitude / 3600 * np.sin(order * np.deg2rad(angle - phase))
    if truth.counts:
        shown = np.floor(shown / 360 * truth.counts) * 360 / truth.counts
    return np.asarray(shown % 360)


def _motion(ask: Ask, t: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    if ask.kind == "sine":
        omega = 2 * np.pi * ask.frequency
        return ask.rate / omega * (1 - np.cos(omega * t)), ask.rate * np.sin(omega * t)
    return ask.rate * t, np.full_like(t, ask.rate)
