"""Every effect of a drive and of a chamber: described as the gyro's are, gone at zero, else finite."""

from __future__ import annotations

from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chamber_effects.air import air_c
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect, ChamberSignals
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.effect import DriveEffect, DriveSignals
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.registry import effects as gyro_effects

KNOWN: dict[str, type[DescribedEffect]] = {**drive_effects(), **chamber_effects()}
DRIVE = sorted(drive_effects().items())
CHAMBER = sorted(chamber_effects().items())


def _drive_signals() -> DriveSignals:
    time_s = np.linspace(0.0, 3.99, 400)
    rate = 3.0 * np.sin(1.7 * time_s)
    return DriveSignals(
        time_s=time_s,
        interval_s=0.01,
        angle_deg=np.degrees(np.cumsum(rate) * 0.01),
        rate_rad_s=rate,
        acceleration_rad_s2=5.1 * np.cos(1.7 * time_s),
        torque_nm=0.05 * 5.1 * np.cos(1.7 * time_s) + 0.03 * rate,
        inertia_kg_m2=0.05,
        viscous_nm_s=0.03,
    )


def _chamber_signals() -> ChamberSignals:
    time_s = np.linspace(0.0, 299.5, 600)
    return ChamberSignals(
        time_s=time_s,
        interval_s=0.5,
        drive=np.where(time_s < 50.0, 0.0, 40.0),
        room_c=np.full(600, 22.0),
        loss=np.ones(600),
        second_c=np.linspace(22.0, 30.0, 600),
    )


def _begun(kind: type[DescribedEffect]) -> list[DescribedEffect]:
    """The effect at every place of each parameter's scan, the others at their first."""
    first = {name: parameter.scan[0] for name, parameter in kind.parameters.items()}
    return [kind.make(first | {name: value}) for name, parameter in kind.parameters.items() for value in parameter.scan]


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_an_effect_says_all_of_itself(name: str) -> None:
    kind = KNOWN[name]
    assert kind.identifier == name
    assert kind.words.endswith(".")
    assert kind.equation
    assert kind.coordinate
    assert kind.excited_by
    assert set(kind.look_alikes) <= set(KNOWN) - {name}
    needed = [field.name for field in fields(kind) if field.default is MISSING]  # type: ignore[arg-type]
    assert set(needed) <= set(kind.parameters)
    for parameter in kind.parameters.values():
        assert parameter.low < parameter.high
        assert all(parameter.low <= value <= parameter.high for value in parameter.scan)
    for effect in _begun(kind):
        assert effect.says().endswith(".")


def test_no_name_is_that_of_an_effect_of_the_gyro() -> None:
    assert len(KNOWN) == len(DRIVE) + len(CHAMBER) >= 16
    assert not set(KNOWN) & set(gyro_effects())


@pytest.mark.parametrize(("name", "kind"), DRIVE)
def test_an_effect_of_a_drive_is_gone_at_zero_and_changes_the_torque_elsewhere(
    name: str, kind: type[DriveEffect]
) -> None:
    signals = _drive_signals()
    first = {parameter: described.scan[0] for parameter, described in kind.parameters.items()}
    zeros = {
        parameter: described.zero for parameter, described in kind.parameters.items() if described.zero is not None
    }
    assert zeros, name
    assert kind.make(first | zeros).apply(signals) == pytest.approx(signals.torque_nm, abs=1e-15)
    for effect in _begun(kind):
        torque = effect.apply(signals)  # type: ignore[attr-defined]
        assert torque.shape == signals.torque_nm.shape
        assert np.isfinite(torque).all()
        assert np.abs(torque - signals.torque_nm).max() > 0.0


@pytest.mark.parametrize(("name", "kind"), CHAMBER)
def test_an_effect_of_a_chamber_is_gone_at_its_zero_and_leaves_the_air_finite(
    name: str, kind: type[ChamberEffect]
) -> None:
    signals = _chamber_signals()
    plain = air_c(signals, 23.0, 4.0, 180.0)
    first = {parameter: described.scan[0] for parameter, described in kind.parameters.items()}
    zeros = {
        parameter: described.zero for parameter, described in kind.parameters.items() if described.zero is not None
    }
    if zeros:
        gone = kind.make(first | zeros).apply(signals)
        assert air_c(gone, 23.0, 4.0, 180.0) == pytest.approx(plain, abs=1e-9)
    else:
        assert name == "ramp_limit"  # which is gone at a slope without limit
        gone = kind.make({"c_per_min": kind.parameters["c_per_min"].high * 1e6}).apply(signals)
        assert gone.drive == pytest.approx(signals.drive)
    for effect in _begun(kind):
        air = air_c(effect.apply(signals), 23.0, 4.0, 180.0)  # type: ignore[attr-defined]
        assert np.isfinite(air).all()
        assert np.abs(air - plain).max() > 0.0


def test_cogging_within_a_sample_is_averaged_over_it() -> None:
    kind = drive_effects()["cogging_torque"]
    fine = np.linspace(0.0, 0.3999, 4000)
    coarse = fine.reshape(-1, 100).mean(axis=1)
    turns = 2.0 * 2 * np.pi  # rad/s
    values = {"amplitude_nm": 0.01, "phase_deg": 20.0, "order": 30.0}

    def torque(time_s: FloatArray, interval_s: float) -> FloatArray:
        none = np.zeros(time_s.size)
        signals = DriveSignals(
            time_s=time_s,
            interval_s=interval_s,
            angle_deg=np.degrees(turns * time_s),
            rate_rad_s=np.full(time_s.size, turns),
            acceleration_rad_s2=none,
            torque_nm=none,
            inertia_kg_m2=0.0,
            viscous_nm_s=0.0,
        )
        return kind.make(values).apply(signals)

    averaged = torque(fine, 1e-4).reshape(-1, 100).mean(axis=1)
    assert torque(coarse, 0.01) == pytest.approx(averaged, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "values"),
    [("coulomb_friction", {"coulomb_nm": 0.03}), ("stribeck_friction", {"breakaway_nm": 0.05, "velocity_rad_s": 0.05})],
)
def test_friction_within_a_sample_is_averaged_over_it_where_the_motion_turns_round(
    name: str, values: dict[str, float]
) -> None:
    def torque(interval_s: float) -> FloatArray:
        time_s = (np.arange(round(4.0 / interval_s)) + 0.5) * interval_s
        rate = 0.3 * np.sin(8.0 * time_s)
        signals = replace(
            _drive_signals(),
            time_s=time_s,
            interval_s=interval_s,
            angle_deg=np.zeros_like(time_s),
            rate_rad_s=rate,
            acceleration_rad_s2=2.4 * np.cos(8.0 * time_s),
            torque_nm=np.zeros_like(time_s),
        )
        effect = drive_effects()[name].make(values)
        assert isinstance(effect, DriveEffect)
        return effect.apply(signals)

    averaged = torque(1e-5).reshape(-1, 1000).mean(axis=1)
    assert torque(0.01) == pytest.approx(averaged, abs=2e-4)


def test_the_drive_behind_a_second_lag_is_its_mean_over_a_sample() -> None:
    coarse, fine = _chamber_signals(), 50
    interval_s = coarse.interval_s / fine
    many = coarse.time_s.size * fine
    steps = replace(
        coarse,
        time_s=np.arange(many) * interval_s,
        interval_s=interval_s,
        drive=np.repeat(coarse.drive, fine),
        room_c=np.repeat(coarse.room_c, fine),
        loss=np.repeat(coarse.loss, fine),
    )
    lag = chamber_effects()["second_lag"].make({"tau_s": 3.0})
    told = lag.apply(steps).drive.reshape(-1, fine).mean(axis=1)
    assert np.abs(lag.apply(coarse).drive - told).max() < 1e-3 * np.ptp(coarse.drive)
