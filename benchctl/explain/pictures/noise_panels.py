"""Noise in pictures: samples with and without an effect, their Allan deviation, their spectrum."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from benchctl.explain.pictures.gyro_scenes import Scene
from benchctl.explain.pictures.sketch import Curve, FloatArray, Look, Panel
from benchctl.metrology.allan import averaging_factors
from benchctl.metrology.deviations import deviation
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.response_gyro import ResponseParameters

_DEG_PER_H = 3600.0
_EXCERPT_S, _MEAN_S = 0.2, 10.0
_LOOKS: Mapping[tuple[str, bool], Look] = {
    ("on", True): "on dots",
    ("off", True): "off dots",
    ("on", False): "on",
    ("off", False): "grey",
}
"""By whether the effect is on, and whether samples are drawn as dots."""


def panels(
    scene: Scene, off: Signals, on: Signals, gyro: ResponseParameters, *, seen_in_rate: float
) -> Iterator[Panel]:
    """Samples of the output less what the motion makes of it; `seen_in_rate` are the volts of one °/s."""
    straight = gyro.U0_v + gyro.K0_v_per_dps * scene.signals.rate_dps
    noises = [("off", "without the effect", off.output_v - straight), ("on", "with it", on.output_v - straight)]
    dotted = scene.x_says == "rate (°/s)"
    # what has the larger scatter is drawn first, so that the other one is seen before it
    louder = sorted(noises, key=lambda one: -float(np.std(one[2])))
    yield Panel(
        x=scene.x_says,
        y="means of 10 s (mV)" if scene.allan else "noise (mV)",
        curves=tuple(
            Curve(x=_shown(scene, scene.x), y=1e3 * _shown(scene, volts), look=_LOOKS[look, dotted], label=label)
            for look, label, volts in louder
        ),
        share=1.3,
    )
    if scene.allan:
        yield _allan(scene, noises, seen_in_rate)
    if scene.spectrum:
        yield _spectrum(scene, noises)
    if dotted:
        yield _scatter(scene, noises)


def _shown(scene: Scene, values: FloatArray) -> FloatArray:
    """What of the samples is drawn: means where they are many, an excerpt where they are quick."""
    if scene.allan:
        long = round(_MEAN_S / scene.signals.interval_s)
        means: FloatArray = values[: values.size // long * long].reshape(-1, long).mean(axis=1)
        return means
    return values[scene.x <= _EXCERPT_S] if scene.spectrum else values


def _allan(scene: Scene, noises: list[tuple[str, str, FloatArray]], v_per_dps: float) -> Panel:
    interval_s = scene.signals.interval_s
    factors = averaging_factors(scene.x.size)
    curves = []
    tau_s = np.asarray(factors * interval_s, dtype=np.float64)
    for look, label, volts in noises:
        deviations = _DEG_PER_H / v_per_dps * deviation(volts, factors, interval_s)
        curves.append(Curve(x=tau_s, y=deviations, look="on" if look == "on" else "off", label=label))
    return Panel(x="averaging time τ (s)", y="Allan deviation (°/h)", curves=tuple(curves), logarithmic="xy", share=1.3)


def _spectrum(scene: Scene, noises: list[tuple[str, str, FloatArray]]) -> Panel:
    frequency = np.asarray(np.fft.rfftfreq(scene.x.size, scene.signals.interval_s)[1:], dtype=np.float64)
    curves = []
    for look, label, volts in reversed(noises):
        amplitude = 2.0 * np.abs(np.fft.rfft(volts - volts.mean()))[1:] / volts.size
        curves.append(Curve(x=frequency, y=1e3 * amplitude, look="on" if look == "on" else "grey", label=label))
    return Panel(x="frequency (Hz)", y="amplitude (mV)", curves=tuple(curves), logarithmic="xy", share=1.2)


def _scatter(scene: Scene, noises: list[tuple[str, str, FloatArray]]) -> Panel:
    """The standard deviation in slices of the rate."""
    edges = np.linspace(float(scene.x.min()), float(scene.x.max()), 31)
    place = np.clip(np.digitize(scene.x, edges) - 1, 0, edges.size - 2)
    curves = []
    for look, label, volts in noises:
        spread = np.array([1e3 * np.std(volts[place == k]) for k in range(edges.size - 1)])
        middle = 0.5 * (edges[1:] + edges[:-1])
        curves.append(Curve(x=middle, y=spread, look="on" if look == "on" else "off", label=label))
    return Panel(x=scene.x_says, y="its deviation (mV)", curves=tuple(curves), share=0.9)
