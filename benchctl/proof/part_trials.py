"""Sealed trials of a table's drive and of a chamber: a run is drawn with its concealed effects, and simulated.

The motion of a drive is prescribed and its torque computed 2000 times a second, of which every tenth value is recorded.
The air of a chamber is simulated with random draughts, and is read once a second with the resolution of a thermometer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from benchctl.diagnosis.result import Part, Verdict
from benchctl.proof.classes import CLASSES, ClassName
from benchctl.proof.draw import draw, rounded
from benchctl.proof.structures import structure_of_part
from benchctl.proof.truth import Effects, Sealed, Truth
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chamber_effects.air import air_c
from benchctl_instruments.physics.chamber_effects.effect import ChamberSignals
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.effect import DriveSignals, DriveStage
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import pushed, structure_named

_NOTHING_IN = 4
"""One trial in this many conceals nothing."""
_STEPS = 10
"""Simulation steps per sample."""
_DRIVE_S, _DRIVE_HZ = 120.0, 200.0
_CHAMBER_S, _CHAMBER_HZ, _RESTS_S = 2400.0, 1.0, 60.0
_NOISE_NM, _ENCODER_DEG = 0.004, 0.5 / 3600.0
_ROOM_C, _READING_C, _STEP_C = 22.0, 0.03, 0.1
_REACH_C = (10.0, 270.0)

_SIZES: Mapping[str, Mapping[str, Mapping[str, tuple[float, float]]]] = {
    "drive": {
        "coulomb_friction": {"coulomb_nm": (0.01, 0.05)},
        "stribeck_friction": {"breakaway_nm": (0.02, 0.08), "velocity_rad_s": (0.05, 0.2)},
        "torque_offset": {"offset_nm": (-0.03, 0.03)},
        "gravity": {"moment_nm": (0.01, 0.06), "hangs_at_deg": (0.0, 360.0)},
        "cogging_torque": {"amplitude_nm": (0.005, 0.03), "phase_deg": (0.0, 360.0), "order": (4.0, 24.0)},
    },
    "chamber": {
        "dead_time": {"delay_s": (8.0, 25.0)},
        "second_lag": {"tau_s": (15.0, 50.0)},
        "exchange": {"rate_per_s": (1e-3, 4e-3)},
        "loss_step": {"fraction": (-0.7, -0.3), "moment": (0.3, 0.7)},
        "heater_nonlinearity": {"curvature": (-0.4, -0.15)},
        "heat_store": {"capacity": (0.5, 1.5), "tau_s": (200.0, 600.0)},
    },
}
"""Ranges from which an effect's parameters are drawn; a range may include both signs."""
_RANGES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "drive": {"angle": (0.0, 360.0), "time": (0.0, _DRIVE_S), "rate": (-90.0, 180.0)},
    "chamber": {"time": (0.0, _CHAMBER_S), "chamber_temp": (25.0, 75.0), "heater": (0.0, 60.0)},
}
"""By coordinate, the lowest value and the width of the range that every run covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartTruth(Sealed):
    """What a trial of a drive or a chamber conceals; `baseline` holds the parameters of its model."""

    baseline: Mapping[str, float]

    @property
    def part(self) -> Part:
        """The part of the bench."""
        return CLASSES[self.kind].part

    @property
    def verdict(self) -> Verdict:
        """The correct verdict of a diagnosis; some trials conceal nothing."""
        if self.withheld and self.nameable:
            return "missing-physics"
        return CLASSES[self.kind].verdict if self.effects else "consistent"

    def kind_of(self, name: str) -> type[DescribedEffect]:
        """Return the effect of this name."""
        return structure_named(name) or _kinds(self.part)[name]

    def as_json(self) -> dict[str, Any]:
        """Return the truth as JSON data."""
        return asdict(self)

    def record(self, folder: Path) -> tuple[Path, int]:
        """Simulate the run and write its recording; return its path and its number of samples."""
        draws = np.random.default_rng(self.seed)
        channels = _drive(self, draws) if self.part == "drive" else _chamber(self, draws)
        rows = channels["time_s"].size
        end_s = float(channels["time_s"][-1])
        info = StepInfo(
            index=1, name="run", kind="motion", t_start=0.0, t_end=end_s, chamber_setpoint_c=_ROOM_C, samples=rows
        )
        rate_hz = _DRIVE_HZ if self.part == "drive" else _CHAMBER_HZ
        meta = Meta(
            status="complete", unit=Unit(serial="SEALED", range_dps=0.0), bench=BenchFacts(sample_rate_hz=rate_hz)
        )
        path = folder.with_suffix(".h5")
        write_recording(path, meta, [Step(info, channels)])
        return path, rows


def drawn(seed: int, index: int, kind: ClassName) -> Truth | PartTruth:
    """Return what trial `index` of a proof conceals, whatever part its class has; reproducible for a given seed."""
    if CLASSES[kind].part == "gyro":
        return draw(seed, index, kind)
    rng = np.random.default_rng([seed, index])
    part = CLASSES[kind].part
    effects: dict[str, Mapping[str, float]] = {}
    names = rng.permutation(list(_SIZES[part]))[: 2 if rng.random() < 0.5 else 1].tolist()
    if CLASSES[kind].structure:
        names = names[:1] if len(names) > 1 else []
    elif index % _NOTHING_IN == _NOTHING_IN - 1:
        names = []
    for name in names:
        look_alikes = _kinds(part)[name].look_alikes
        if not any(name in _kinds(part)[one].look_alikes or one in look_alikes for one in effects):
            effects[name] = {
                one: float(round(rng.uniform(*ends))) if one == "order" else rounded(rng.uniform(*ends))
                for one, ends in _SIZES[part][name].items()
            }
    withheld: tuple[str, ...] = ()
    if CLASSES[kind].structure:
        found, values = structure_of_part("drive" if part == "drive" else "chamber", rng, _RANGES[part])
        effects[found] = {one: rounded(value) for one, value in values.items()}
        withheld = (found,)
    low, high = ((0.02, 0.02), (0.06, 0.05)) if part == "drive" else ((2.0, 120.0), (4.0, 300.0))
    parameters = ("inertia_kg_m2", "viscous_nm_s") if part == "drive" else ("gain_c_per_percent", "tau_s")
    numbers = [rounded(rng.uniform(*ends)) for ends in zip(low, high, strict=True)]
    return PartTruth(
        index=index,
        kind=kind,
        seed=int(rng.integers(2**31)),
        effects=effects,
        withheld=withheld,
        lives_in=tuple(one.partition("_over_")[2] for one in withheld),
        baseline=dict(zip(parameters, numbers, strict=True)),
        nonce=np.random.default_rng([seed, index, 1]).bytes(16).hex(),
    )


def _kinds(part: str) -> Mapping[str, type[DescribedEffect]]:
    return drive_effects() if part == "drive" else chamber_effects()


def _made(effects: Effects, part: str, duration_s: float, largest: float = 1.0) -> list[Any]:
    about = {"duration_s": duration_s, "largest_drive": largest}
    return [_kinds(part)[name].make(values, about) for name, values in effects.items()]


def _drive(truth: PartTruth, draws: np.random.Generator) -> dict[str, FloatArray]:
    """Simulate a table that swings slowly over more than a turn, with faster swings superposed."""
    step_s = 1.0 / (_DRIVE_HZ * _STEPS)
    time_s = np.arange(round(_DRIVE_S / step_s), dtype=np.float64) * step_s
    angle, rate, acceleration = np.zeros((3, time_s.size))
    for turned_rad, hz in ((4.0, 0.04), (0.4, 0.31), (0.03, 1.7)):
        turn, phase = 2.0 * math.pi * hz, draws.uniform(0.0, 2.0 * math.pi)
        angle += turned_rad * np.sin(turn * time_s + phase)
        rate += turned_rad * turn * np.cos(turn * time_s + phase)
        acceleration -= turned_rad * turn**2 * np.sin(turn * time_s + phase)
    inertia, viscous = truth.baseline.values()
    signals = DriveSignals(
        time_s=time_s,
        interval_s=step_s,
        angle_deg=np.degrees(angle),
        rate_rad_s=rate,
        acceleration_rad_s2=acceleration,
        torque_nm=inertia * acceleration + viscous * rate,
        inertia_kg_m2=inertia,
        viscous_nm_s=viscous,
    )
    stages = get_args(DriveStage)
    named = {name: values for name, values in truth.effects.items() if name not in truth.withheld}
    for effect in sorted(_made(named, "drive", _DRIVE_S), key=lambda one: stages.index(one.stage)):
        signals = replace(signals, torque_nm=effect.apply(signals))
    coordinates = {"time": time_s, "angle": np.mod(np.degrees(angle), 360.0), "rate": np.degrees(rate)}
    for name in truth.withheld:
        if (found := structure_named(name)) is not None:
            torque_nm = found.make(truth.effects[name]).value_at(coordinates[found.over])
            signals = replace(signals, torque_nm=signals.torque_nm + torque_nm)
    read = slice(None, None, _STEPS)
    rows = time_s[read].size
    return {
        "time_s": time_s[read],
        "encoder_deg": np.mod(signals.angle_deg[read] + draws.normal(0.0, _ENCODER_DEG, rows), 360.0),
        "torque_nm": signals.torque_nm[read] + draws.normal(0.0, _NOISE_NM, rows),
    }


def _chamber(truth: PartTruth, draws: np.random.Generator) -> dict[str, FloatArray]:
    """Simulate a chamber whose heater is switched between random powers, with a second body next to the air."""
    step_s = 1.0 / (_CHAMBER_HZ * _STEPS)
    time_s = np.arange(round(_CHAMBER_S / step_s), dtype=np.float64) * step_s
    starts_s = np.concatenate([[0.0], np.cumsum([_RESTS_S, *np.round(draws.uniform(100.0, 400.0, 12))])])
    powers = np.concatenate([[0.0], np.round(draws.uniform(0.0, 60.0, starts_s.size - 1))])
    power = powers[np.searchsorted(starts_s, time_s + step_s / 2.0, side="right") - 1]
    second = _ROOM_C + 15.0 * (1.0 - np.cos(2.0 * math.pi * time_s / draws.uniform(700.0, 1500.0)))
    signals = ChamberSignals(
        time_s=time_s,
        interval_s=step_s,
        drive=power,
        room_c=np.full_like(time_s, _ROOM_C),
        loss=np.ones_like(time_s),
        second_c=second,
    )
    gain, tau_s = truth.baseline.values()
    unnamed = [kind.make(truth.effects[name]) for name in truth.withheld if (kind := structure_named(name)) is not None]
    signals = pushed(signals, unnamed, time_s, gain, _REACH_C)
    named = {name: values for name, values in truth.effects.items() if name not in truth.withheld}
    for effect in _made(named, "chamber", _CHAMBER_S, float(power.max())):
        signals = effect.apply(signals)
    pushes = draws.normal(0.0, draws.uniform(0.005, 0.02) * math.sqrt(step_s), time_s.size)
    signals = replace(signals, drive=signals.drive + pushes * tau_s / (gain * step_s))
    air = air_c(signals, _ROOM_C, gain, tau_s)
    read = slice(None, None, _STEPS)
    reading_c = air[read] + draws.normal(0.0, _READING_C, air[read].size)
    return {
        "time_s": time_s[read],
        "chamber_temp_c": np.round(reading_c / _STEP_C) * _STEP_C,
        "heater_percent": power[read],
        "ambient_temp_c": signals.room_c[read],
        "second_temp_c": second[read],
    }
