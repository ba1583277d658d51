"""An effect of the chamber, switched on against off: the air that follows power or set point."""

from __future__ import annotations

import numpy as np

from benchctl.explain.pictures.sizing import Values, said_values, seen_values, stated_values
from benchctl.explain.pictures.sketch import Curve, FloatArray, Panel, Sketch
from benchctl_instruments.physics.chamber_effects.air import air_c
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals, Drive

_ROOM_C, _TAU_S, _GAIN_C_PER_PERCENT = 20.0, 600.0, 1.0
_INTERVAL_S, _STEP_S, _HOURS = 10.0, 3600.0, 4.0
_SEEN = 0.1
"""Of the course: what is drawn at its true size must be seen."""


def chamber_sketch(kind: type[ChamberEffect]) -> Sketch:
    """The picture of an effect: the air's course with and without it, and by how much they part."""
    drive: Drive = "power" if "power" in kind.drives else "setpoint"
    plain = _run(drive)
    values = stated_values(kind.identifier) or seen_values(kind, lambda tried: _share(kind, tried, plain), _SEEN)
    hours, off = plain.time_s / 3600.0, _air(plain)
    on = _with(kind, values, plain)
    what, unit = ("heater", "%") if drive == "power" else ("set point", "°C")
    return Sketch(
        title=kind.identifier.replace("_", " ").capitalize(),
        caption=f"Steps of the {what}; {said_values(kind, values)}.",
        panels=(
            Panel(
                x="time (h)",
                y=f"{what} ({unit})",
                curves=(Curve(x=hours, y=plain.drive, look="grey"),),
                share=0.5,
            ),
            Panel(
                x="time (h)",
                y="air (°C)",
                curves=(
                    Curve(x=hours, y=off, look="off", label="without the effect"),
                    Curve(x=hours, y=on, look="on", label="with it"),
                ),
            ),
            Panel(
                x="time (h)",
                y="difference (°C)",
                curves=(Curve(x=hours, y=on - off, look="on"),),
                zero=True,
                share=0.8,
            ),
        ),
        difference=on - off,
    )


def _run(drive: Drive) -> ChamberSignals:
    """Steps up and down. A set point is what the air comes to; power adds to the room's temperature."""
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


def _share(kind: type[ChamberEffect], values: Values, run: ChamberSignals) -> float:
    off = _air(run)
    return float(np.max(np.abs(_with(kind, values, run) - off))) / float(np.ptp(off))
