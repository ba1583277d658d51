"""An effect of the table's drive, switched on against off: the torque that a motion takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchctl.explain.pictures.sizing import Values, said_values, seen_values, stated_values
from benchctl.explain.pictures.sketch import Curve, FloatArray, Panel, Sketch
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals

_INERTIA_KG_M2, _VISCOUS_NM_S = 0.02, 0.05
_TOP_DPS = 100.0
_HOUR_S = 3600.0
_SEEN = 0.15
"""Of the torque: what is drawn at its true size must be seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    signals: DriveSignals
    x: FloatArray
    x_says: str
    says: str


def drive_sketch(kind: type[DriveEffect]) -> Sketch:
    """The picture of an effect: torque with and without it, and what it adds."""
    scene = _SCENES.get(kind.coordinate, _hour)()
    values = stated_values(kind.identifier) or seen_values(kind, lambda tried: _share(kind, tried, scene), _SEEN)
    x, off = scene.x, scene.signals.torque_nm
    on = _torque(kind, values, scene)
    return Sketch(
        title=kind.identifier.replace("_", " ").capitalize(),
        caption=f"{scene.says}; {said_values(kind, values)}.",
        panels=(
            Panel(
                x=scene.x_says,
                y="torque (N·m)",
                curves=(
                    Curve(x=x, y=off, look="off", label="without the effect"),
                    Curve(x=x, y=on, look="on", label="with it"),
                ),
            ),
            Panel(
                x=scene.x_says,
                y="difference (mN·m)",
                curves=(Curve(x=x, y=1e3 * (on - off), look="on"),),
                zero=True,
                share=0.8,
            ),
        ),
        difference=on - off,
    )


def _torque(kind: type[DriveEffect], values: Values, scene: _Scene) -> FloatArray:
    effect = kind.make(values, {"duration_s": float(scene.signals.time_s[-1])})
    return effect.apply(scene.signals)


def _share(kind: type[DriveEffect], values: Values, scene: _Scene) -> float:
    off = scene.signals.torque_nm
    height = float(np.ptp(off)) or float(np.max(np.abs(off)))
    return float(np.max(np.abs(_torque(kind, values, scene) - off))) / height


def _sweep() -> _Scene:
    rate_dps = np.linspace(-_TOP_DPS, _TOP_DPS, 4000)
    return _Scene(
        signals=_signals(np.linspace(0.0, _HOUR_S, rate_dps.size), rate_dps),
        x=rate_dps,
        x_says="rate (°/s)",
        says=f"Rates up to ±{_TOP_DPS:g} °/s",
    )


def _turn() -> _Scene:
    time_s = np.linspace(0.0, 72.0, 2001)
    scene = _signals(time_s, np.full_like(time_s, 10.0))
    return _Scene(signals=scene, x=scene.angle_deg, x_says="angle of the table (°)", says="Two turns at 10 °/s")


def _hour() -> _Scene:
    time_s = np.linspace(0.0, _HOUR_S, 1801)
    signals = _signals(time_s, np.full_like(time_s, 60.0))
    return _Scene(signals=signals, x=time_s / 60.0, x_says="time (min)", says="An hour at 60 °/s")


def _reversals() -> _Scene:
    interval_s = 2e-3
    time_s = np.linspace(0.0, interval_s * 1299, 1300)
    acceleration = np.zeros_like(time_s)
    acceleration[300:500], acceleration[900:1100] = 500.0, -500.0
    rate = -_TOP_DPS + np.cumsum(acceleration) * interval_s
    signals = _signals(time_s, rate, acceleration)
    return _Scene(signals=signals, x=time_s, x_says="time (s)", says="Reversals at 500 °/s²")


_SCENES: Mapping[str, Callable[[], _Scene]] = {
    "rate": _sweep,
    "abs_rate": _sweep,
    "rate_sign": _sweep,
    "output": _sweep,
    "angle": _turn,
    "acceleration": _reversals,
    "time": _hour,
}


def _signals(time_s: FloatArray, rate_dps: FloatArray, acceleration: FloatArray | None = None) -> DriveSignals:
    rate = np.radians(rate_dps)
    faster = np.zeros_like(rate) if acceleration is None else np.radians(acceleration)
    interval_s = float(time_s[1] - time_s[0])
    return DriveSignals(
        time_s=time_s,
        interval_s=interval_s,
        angle_deg=np.cumsum(rate_dps) * interval_s,
        rate_rad_s=rate,
        acceleration_rad_s2=faster,
        torque_nm=_INERTIA_KG_M2 * faster + _VISCOUS_NM_S * rate,
        inertia_kg_m2=_INERTIA_KG_M2,
        viscous_nm_s=_VISCOUS_NM_S,
    )
