"""Draw an effect of the gyro, with and without it, in a motion that excites it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchctl.explain.glossary import extra
from benchctl.explain.pictures.gyro_scenes import BY_COORDINATE, BY_NAME, CIRCUMSTANCES, T0_C, Make, Scene, long_rest
from benchctl.explain.pictures.gyro_scenes import noisy_rest as noisy_rest_scene
from benchctl.explain.pictures.sketch import (
    Look,
    Panel,
    Sketch,
    SketchedCurve,
    Values,
    described_values,
    stated_values,
    title_of,
    visible_values,
    whole_values,
)
from benchctl.explain.sizes import K0_V_PER_DPS, NOISE_V, RANGE_DPS, middle_size
from benchctl.metrology.allan import averaging_factors
from benchctl.metrology.deviations import deviation
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import GRID_STAGES, Signals, run_chain
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.kinds import ClockEffect, NoiseEffect
from benchctl_instruments.physics.response_gyro import ResponseParameters, response_baseline

GYRO = ResponseParameters(
    K0_v_per_dps=K0_V_PER_DPS,
    U0_v=0.012,
    T0_c=T0_C,
    k_T=(-1.315e-4, 2.066e-6),
    k_omega=(),
    noise_v_rms=NOISE_V,
    output_limit_v=11.0,
)
"""The gyro without any effect: linear in the rate, with a temperature-dependent scale factor."""

_SEEN = 0.03
"""Share of the output that an effect without a known size is drawn to change."""
_FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_PLAIN, _EXAGGERATED = 0.08, 0.25
"""An effect that changes a smaller share of the output than the first is enlarged, up to the second."""
_MANY_CROSSINGS, _SHOWN_CROSSINGS = 60, 12
_LOUD = 0.01
"""Changes below this share of the largest change are rounding errors; their sign is ignored."""
_NARROW = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """The simulated signals of a scene: `y` over the scene's x."""

    scene: Scene
    off: Signals
    on: Signals
    by_encoder: bool

    @property
    def y_off(self) -> FloatArray:
        return _encoder_rate(self.off) if self.by_encoder else self.off.output_v

    @property
    def y_on(self) -> FloatArray:
        return _encoder_rate(self.on) if self.by_encoder else self.on.output_v

    @property
    def difference(self) -> FloatArray:
        return self.y_on - self.y_off


def gyro_sketch(kind: type[PhysicalEffect]) -> Sketch:
    """Return the sketch of an effect: the change of the output, or of the encoder's reading."""
    make = _scene_of(kind)
    known = stated_values(kind.identifier) or middle_size(kind.identifier)
    values = whole_values(kind, known)
    if not known:
        values = visible_values(kind, lambda tried: _share(_run(kind, tried, make, RANGE_DPS)), _SEEN)
    run = _run(kind, values, make, RANGE_DPS)
    top_dps = _zoomed(run)
    if top_dps is not None:
        run = _run(kind, values, make, top_dps)
    panels, note = _panels(run)
    return Sketch(
        title=title_of(kind),
        caption=f"{run.scene.description}; {described_values(kind, values)}.{note}",
        panels=tuple(panels),
        difference=run.difference,
    )


def _scene_of(kind: type[PhysicalEffect]) -> Make:
    named = extra("effects", kind.identifier).get("scene")
    if named is not None:
        return BY_NAME[named]
    if issubclass(kind, NoiseEffect):
        return noisy_rest_scene
    return BY_COORDINATE.get(kind.coordinate, long_rest)


def _run(kind: type[PhysicalEffect], values: Values, make: Make, top_dps: float) -> _Run:
    effect = kind.make(values, {**CIRCUMSTANCES, "noise_v_rms": NOISE_V})
    scene = make(effect, top_dps)
    off, on = _played(scene, None), _played(scene, effect)
    by_encoder = np.array_equal(off.output_v, on.output_v) and not np.array_equal(off.encoder_deg, on.encoder_deg)
    run = _Run(scene=scene, off=off, on=on, by_encoder=by_encoder)
    if not np.isfinite(run.difference).all():
        at = described_values(kind, values)
        raise UsageError(f"effect {kind.identifier}: expected finite outputs at {at}, got others; mend its apply")
    return run


def _played(scene: Scene, effect: PhysicalEffect | None) -> Signals:
    """Return the scene's signals after the chain and the sampling."""
    effects = () if effect is None else (effect,)
    signals = run_chain(scene.signals, response_baseline(GYRO), effects, GRID_STAGES)
    volts = signals.output_v
    if isinstance(effect, ClockEffect):
        volts = _at(effect.gyro_time_s(signals.time_s), signals.time_s, volts)
    if scene.noisy:
        volts = volts + NOISE_V * np.random.default_rng(952).standard_normal(volts.size)
    return run_chain(replace(signals, output_v=volts), {}, effects, ("sampling",))


def _at(when_s: FloatArray, time_s: FloatArray, volts: FloatArray) -> FloatArray:
    """Return the output at other times, by linear interpolation, and by extrapolation beyond the ends."""
    inside = np.clip(when_s, time_s[0], time_s[-1])
    slope = np.gradient(volts, time_s)
    return np.interp(inside, time_s, volts) + (when_s - inside) * np.interp(inside, time_s, slope)


def _share(run: _Run) -> float:
    """Return the largest change due to an effect, relative to the range of the output."""
    return float(np.max(np.abs(run.difference))) / _height(run.y_off)


def _height(y: FloatArray) -> float:
    return float(np.ptp(y)) or float(np.max(np.abs(y))) or 1.0


def _zoomed(run: _Run) -> float | None:
    """Return a smaller top rate for effects that act at small rates only, or repeat too often; else None."""
    scene, changed = run.scene, np.abs(run.difference)
    if scene.x_label != "rate (°/s)" or scene.noisy:
        return None
    top_dps = float(np.nanmax(scene.x))
    loud = run.difference[changed > _LOUD * changed.max()]
    crossings = int(np.count_nonzero(np.diff(np.sign(loud))))
    if crossings > _MANY_CROSSINGS:
        return top_dps * _SHOWN_CROSSINGS / crossings
    right = scene.x > 0.0
    rates, high = scene.x[right], changed[right] > 0.5 * float(changed.max())
    turning = np.flatnonzero(np.diff(high.astype(np.int8)))
    if turning.size == 0 or _NARROW * rates[turning[0]] > 0.5 * top_dps:
        return None
    return _NARROW * float(rates[turning[0]])


def _panels(run: _Run) -> tuple[list[Panel], str]:
    """Return the panels, and the notes for the caption."""
    scene = run.scene
    factor = _factor(run)
    stimulus = [] if scene.stimulus is None else [_with_coil(scene.stimulus, run)]
    if scene.noisy:
        return [*stimulus, *panels(scene, run.off, run.on, GYRO, seen_in_rate=K0_V_PER_DPS)], ""
    what = "rate by the encoder (°/s)" if run.by_encoder else "output (V)"
    larger = f", {factor} × as large" if factor > 1 else ""
    compared = Panel(
        x=scene.x_label,
        y=what,
        curves=(
            *_parts(scene, run.y_off, "off", "without the effect"),
            *_parts(scene, run.y_off + factor * run.difference, "on", f"with it{larger}"),
        ),
    )
    return [*stimulus, compared, *_difference_panels(run)], " Below: what it really changes." if factor > 1 else ""


def _difference_panels(run: _Run) -> Iterator[Panel]:
    x, changed = run.scene.x, run.difference
    if run.by_encoder:
        unit, factor = ("°/s", 1.0) if np.max(np.abs(changed)) > 0.1 else ("0.001 °/s", 1e3)
        arcsec = 3600.0 * (run.on.encoder_deg - run.off.encoder_deg)
        error = SketchedCurve(x=x, y=arcsec, look="third")
        yield Panel(x=run.scene.x_label, y="error of angle (″)", curves=(error,), zero=True, share=0.8)
    else:
        unit, factor = ("V", 1.0) if np.max(np.abs(changed)) > 1.0 else ("mV", 1e3)
    yield Panel(
        x=run.scene.x_label,
        y=f"difference ({unit})",
        curves=tuple(_parts(run.scene, factor * changed, "on", "")),
        zero=True,
        share=0.8,
    )


def _parts(scene: Scene, y: FloatArray, look: Look, label: str) -> Iterator[SketchedCurve]:
    """Yield a curve, or one for each named part of the scene."""
    looks: tuple[Look, ...] = ("on", "third", "grey") if look == "on" else (look,) * len(scene.parts)
    for place, ((name, part), own) in enumerate(zip(scene.parts, looks, strict=False)):
        text = f"{label}, {name}" if look == "on" else "" if place else label
        yield SketchedCurve(x=scene.x[part], y=y[part], look=own, label=text if label else "")
    if not scene.parts:
        yield SketchedCurve(x=scene.x, y=y, look=look, label=label)


def _factor(run: _Run) -> int:
    """Return the factor by which the effect is enlarged when drawn together with the output."""
    share = _share(run)
    if not run.scene.memoryless or share >= _PLAIN or share == 0.0:
        return 1
    return max(factor for factor in _FACTORS if factor == 1 or factor * share <= _EXAGGERATED)


def _with_coil(panel: Panel, run: _Run) -> Panel:
    """Add the temperature of the coil to the panel if the effect changes it."""
    if np.array_equal(run.on.coil_c, run.off.coil_c):
        return panel
    return replace(
        panel, curves=(*panel.curves, SketchedCurve(x=run.scene.x, y=run.on.coil_c, look="on", label="coil"))
    )


def _encoder_rate(signals: Signals) -> FloatArray:
    return np.gradient(signals.encoder_deg, signals.time_s)


_DEG_PER_H = 3600.0
_EXCERPT_S, _MEAN_S = 0.2, 10.0
_LOOKS: Mapping[tuple[str, bool], Look] = {
    ("on", True): "on dots",
    ("off", True): "off dots",
    ("on", False): "on",
    ("off", False): "grey",
}
"""The key: whether the effect is on, and whether samples are drawn as dots."""


def panels(
    scene: Scene, off: Signals, on: Signals, gyro: ResponseParameters, *, seen_in_rate: float
) -> Iterator[Panel]:
    """Yield the panels of the output less its noise-free value; `seen_in_rate` is the scale factor in V/(°/s)."""
    straight = gyro.U0_v + gyro.K0_v_per_dps * scene.signals.rate_dps
    noises = [("off", "without the effect", off.output_v - straight), ("on", "with it", on.output_v - straight)]
    dotted = scene.x_label == "rate (°/s)"
    # the larger scatter is drawn first, so that it does not hide the other one
    louder = sorted(noises, key=lambda one: -float(np.std(one[2])))
    yield Panel(
        x=scene.x_label,
        y="means of 10 s (mV)" if scene.allan else "noise (mV)",
        curves=tuple(
            SketchedCurve(
                x=_shown(scene, scene.x), y=1e3 * _shown(scene, volts), look=_LOOKS[look, dotted], label=label
            )
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
    """Return the samples to draw: means for an Allan deviation, an excerpt for a spectrum, else all."""
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
        deviations = _DEG_PER_H / v_per_dps * deviation(volts, factors)
        curves.append(SketchedCurve(x=tau_s, y=deviations, look="on" if look == "on" else "off", label=label))
    return Panel(x="averaging time τ (s)", y="Allan deviation (°/h)", curves=tuple(curves), logarithmic=True, share=1.3)


def _spectrum(scene: Scene, noises: list[tuple[str, str, FloatArray]]) -> Panel:
    frequency = np.asarray(np.fft.rfftfreq(scene.x.size, scene.signals.interval_s)[1:], dtype=np.float64)
    curves = []
    for look, label, volts in reversed(noises):
        amplitude = 2.0 * np.abs(np.fft.rfft(volts - volts.mean()))[1:] / volts.size
        curves.append(SketchedCurve(x=frequency, y=1e3 * amplitude, look="on" if look == "on" else "grey", label=label))
    return Panel(x="frequency (Hz)", y="amplitude (mV)", curves=tuple(curves), logarithmic=True, share=1.2)


def _scatter(scene: Scene, noises: list[tuple[str, str, FloatArray]]) -> Panel:
    """Return a panel with the standard deviation in bins of the rate."""
    edges = np.linspace(float(scene.x.min()), float(scene.x.max()), 31)
    place = np.clip(np.digitize(scene.x, edges) - 1, 0, edges.size - 2)
    curves = []
    for look, label, volts in noises:
        spread = np.array([1e3 * np.std(volts[place == k]) for k in range(edges.size - 1)])
        middle = 0.5 * (edges[1:] + edges[:-1])
        curves.append(SketchedCurve(x=middle, y=spread, look="on" if look == "on" else "off", label=label))
    return Panel(x=scene.x_label, y="its deviation (mV)", curves=tuple(curves), share=0.9)
