"""Draw an effect of the table's drive or of the chamber, with and without it: torque, or air temperature."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchctl.explain.pictures.sketch import (
    Panel,
    Sketch,
    SketchedCurve,
    Values,
    compared,
    described_values,
    stated_values,
    title_of,
    visible_values,
)
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chamber_effects.air import air_c
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, Drive
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals

_INERTIA_KG_M2, _VISCOUS_NM_S = 0.02, 0.05
_TOP_DPS = 100.0
_HOUR_S = 3600.0
_SEEN = 0.15
"""Share of the torque that a drawn effect changes, so that it is visible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    signals: DriveSignals
    x: FloatArray
    x_label: str
    description: str


def drive_sketch(kind: type[DriveEffect]) -> Sketch:
    """Return the sketch of an effect: torque with and without it, and the difference."""
    scene = _SCENES.get(kind.coordinate, _hour)()
    values = stated_values(kind.identifier) or visible_values(kind, lambda tried: _share(kind, tried, scene), _SEEN)
    x, off = scene.x, scene.signals.torque_nm
    on = _torque(kind, values, scene)
    return Sketch(
        title=title_of(kind),
        caption=f"{scene.description}; {described_values(kind, values)}.",
        panels=tuple(compared(x, scene.x_label, off, on, "torque (N·m)", difference="mN·m")),
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
        x_label="rate (°/s)",
        description=f"Rates up to ±{_TOP_DPS:g} °/s",
    )


def _turn() -> _Scene:
    time_s = np.linspace(0.0, 72.0, 2001)
    scene = _signals(time_s, np.full_like(time_s, 10.0))
    return _Scene(signals=scene, x=scene.angle_deg, x_label="angle of the table (°)", description="Two turns at 10 °/s")


def _hour() -> _Scene:
    time_s = np.linspace(0.0, _HOUR_S, 1801)
    signals = _signals(time_s, np.full_like(time_s, 60.0))
    return _Scene(signals=signals, x=time_s / 60.0, x_label="time (min)", description="An hour at 60 °/s")


def _reversals() -> _Scene:
    interval_s = 2e-3
    time_s = np.linspace(0.0, interval_s * 1299, 1300)
    acceleration = np.zeros_like(time_s)
    acceleration[300:500], acceleration[900:1100] = 500.0, -500.0
    rate = -_TOP_DPS + np.cumsum(acceleration) * interval_s
    signals = _signals(time_s, rate, acceleration)
    return _Scene(signals=signals, x=time_s, x_label="time (s)", description="Reversals at 500 °/s²")


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


_ROOM_C, _TAU_S, _GAIN_C_PER_PERCENT = 20.0, 600.0, 1.0
_INTERVAL_S, _STEP_S, _HOURS = 10.0, 3600.0, 4.0
_CHAMBER_SHARE = 0.1
"""Share of the air's range that a drawn effect changes, so that it is visible."""


def chamber_sketch(kind: type[ChamberEffect]) -> Sketch:
    """Return the sketch of an effect: air temperature with and without it, and the difference."""
    drive: Drive = "power" if "power" in kind.drives else "setpoint"
    plain = _run(drive)
    values = stated_values(kind.identifier) or visible_values(
        kind, lambda tried: _air_share(kind, tried, plain), _CHAMBER_SHARE
    )
    hours, off = plain.time_s / 3600.0, _air(plain)
    on = _with(kind, values, plain)
    what, unit = ("heater", "%") if drive == "power" else ("set point", "°C")
    return Sketch(
        title=title_of(kind),
        caption=f"Steps of the {what}; {described_values(kind, values)}.",
        panels=(
            Panel(
                x="time (h)",
                y=f"{what} ({unit})",
                curves=(SketchedCurve(x=hours, y=plain.drive, look="grey"),),
                share=0.5,
            ),
            *compared(hours, "time (h)", off, on, "air (°C)", difference="°C"),
        ),
        difference=on - off,
    )


def _run(drive: Drive) -> ChamberSignals:
    """Simulate steps up and down. The air approaches a set point; power adds to the room's temperature."""
    time_s = np.arange(0.0, 3600.0 * _HOURS, _INTERVAL_S)
    above_c = np.interp(time_s // _STEP_S, [0, 1, 2, 3], [0.0, 30.0, 80.0, 10.0])
    room_c = _ROOM_C if drive == "power" else 0.0
    return ChamberSignals(
        time_s=time_s,
        interval_s=_INTERVAL_S,
        drive=above_c + (_ROOM_C - room_c),
        room_c=np.full_like(time_s, room_c),
        loss=np.ones_like(time_s),
        second_c=np.full_like(time_s, _ROOM_C),
    )


def _air(run: ChamberSignals) -> FloatArray:
    return air_c(run, _ROOM_C, _GAIN_C_PER_PERCENT, _TAU_S)


def _with(kind: type[ChamberEffect], values: Values, run: ChamberSignals) -> FloatArray:
    circumstances = {"duration_s": float(run.time_s[-1]), "largest_drive": float(np.max(np.abs(run.drive)))}
    return _air(kind.make(values, circumstances).apply(run))


def _air_share(kind: type[ChamberEffect], values: Values, run: ChamberSignals) -> float:
    off = _air(run)
    return float(np.max(np.abs(_with(kind, values, run) - off))) / float(np.ptp(off))
