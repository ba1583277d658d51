"""A unit of three axes: its matrix, biases and their change with temperature, against the truth and against imucal."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.app.compensate import compensate, own_compensation
from benchctl.calibration.c_header import export_c_header
from benchctl.calibration.coefficients import read_coefficients, write_coefficients
from benchctl.calibration.compensating import export_json, read_compensation
from benchctl.calibration.three_axes import ThreeAxesResult, fit_three_axes, three_axes_coefficients
from benchctl.history.entries import read_document
from benchctl.recordings.model import AXIS_CHANNELS, AXIS_COMPENSATED, Meta, Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import AXIS_POSITIONS, AxisPosition, vertical
from benchctl_instruments.physics.gyro import EARTH_DPS
from benchctl_instruments.physics.three_axes import ThreeAxisParameters, noise_deviation_dps, sensed_rates_dps
from tests.benchctl.calibration.made_coefficients import program_with
from tests.benchctl.recordings.made import info, meta

FRAMES_HZ = 50.0
COUNTS = 65536
LATITUDE_DEG = 58.5
UNIT = ThreeAxisParameters()
RATES_DPS = (0.0, 36.0, -36.0, 60.0, -60.0, 90.0, -90.0, 0.0)
UP: tuple[AxisPosition, ...] = ("x up", "y up", "z up")


def known(latitude_deg: float | None = LATITUDE_DEG) -> Meta:
    made = meta()
    return replace(made, bench=replace(made.bench, latitude_deg=latitude_deg))


def campaign(
    seed: int,
    *,
    positions: Sequence[AxisPosition] = AXIS_POSITIONS,
    set_points_c: Sequence[float] = (20.0,),
    rates_dps: Sequence[float] = RATES_DPS,
    unit: ThreeAxisParameters = UNIT,
    seconds: float = 10.0,
    latitude_deg: float = LATITUDE_DEG,
) -> Iterator[Step]:
    """Steps as `under_test` presents them; the unit is turned to any heading, and the encoder counts."""
    generator = np.random.default_rng(seed)
    index = 0
    for position in positions:
        heading_deg = generator.uniform(0.0, 360.0)
        for setpoint_c in set_points_c:
            for rate_dps in rates_dps:
                index += 1
                time_s = 100.0 * index + np.arange(int(seconds * FRAMES_HZ)) / FRAMES_HZ
                angle_deg = generator.uniform(0.0, 360.0) + rate_dps * (time_s - time_s[0])
                celsius = np.full(time_s.size, setpoint_c + generator.normal(0.0, 0.1))
                sensed = sensed_rates_dps(
                    position, np.full(time_s.size, rate_dps), angle_deg + heading_deg, latitude_deg
                )
                noise = generator.normal(0.0, noise_deviation_dps(unit, 1.0 / FRAMES_HZ), sensed.shape)
                rates = unit.output_dps(sensed, celsius) + noise
                kind = "constant_rate" if rate_dps else "static"
                yield Step(
                    replace(
                        info(index, kind=kind, t_start=time_s[0], t_end=time_s[-1], rate_dps=rate_dps or None),
                        mounting=position,
                        chamber_setpoint_c=setpoint_c,
                    ),
                    {
                        "time_s": time_s,
                        "encoder_deg": np.mod(np.round(angle_deg * COUNTS / 360.0) * 360.0 / COUNTS, 360.0),
                        "gyro_temp_c": celsius,
                        **{f"rate_{axis}_dps": rates[:, i] for i, axis in enumerate("xyz")},
                    },
                )


def truth_of(result: ThreeAxesResult, unit: ThreeAxisParameters = UNIT) -> dict[str, float]:
    """The unit's own numbers, at the temperature of the result."""
    warmer_c = result.T0_c - unit.T0_c
    matrix, per_c = np.reshape(unit.matrix, (3, 3)), np.reshape(unit.matrix_per_c, (3, 3))
    found: dict[str, float] = {}
    for i, output in enumerate("xyz"):
        found |= {f"matrix_{output}{about}": (matrix + warmer_c * per_c)[i, j] for j, about in enumerate("xyz")}
        found |= {f"matrix_{output}{about}_per_c": per_c[i, j] for j, about in enumerate("xyz")}
        found[f"bias_{output}_dps"] = unit.bias_dps[i] + warmer_c * unit.bias_dps_per_c[i]
        found[f"bias_{output}_dps_per_c"] = unit.bias_dps_per_c[i]
    return found


def pulls(result: ThreeAxesResult) -> FloatArray:
    truth = truth_of(result)
    return np.array([(one.value - truth[one.name]) / one.standard for one in result.parameters()])


def test_matrix_and_biases_are_the_units_within_their_uncertainties_over_seeds() -> None:
    found = np.concatenate([pulls(fit_three_axes(campaign(seed), known())) for seed in range(12)])
    assert found.size == 12 * 12
    assert 0.6 < np.sqrt(np.mean(found**2)) < 1.25
    assert np.mean(np.abs(found) < 2.1) > 0.9


def test_with_several_set_points_their_change_with_temperature_is_found_too() -> None:
    results = [fit_three_axes(campaign(seed, set_points_c=(0.0, 40.0), seconds=5.0), known()) for seed in range(5)]
    found = np.concatenate([pulls(result) for result in results])
    assert found.size == 5 * 24
    assert 0.6 < np.sqrt(np.mean(found**2)) < 1.25
    per_c = results[0].per_c
    assert per_c is not None
    assert per_c.standard.matrix.max() < 1e-5  # of changes of 4e-5, so that the test can fail
    assert results[0].T0_c == pytest.approx(20.0, abs=1.0)


def test_the_earths_rate_is_no_part_of_the_bias_whether_the_latitude_is_known_or_not() -> None:
    with_latitude = [fit_three_axes(campaign(seed, positions=UP), known()) for seed in range(6)]
    without = [fit_three_axes(campaign(seed, positions=UP), known(None)) for seed in range(6)]
    for results in (with_latitude, without):
        biases = np.array([result.at_T0.value.bias_dps - UNIT.bias_dps for result in results])
        standard = np.array([result.at_T0.standard.bias_dps for result in results])
        assert np.abs(biases.mean(axis=0)).max() < 0.2 * EARTH_DPS
        assert np.sqrt(np.mean((biases / standard) ** 2)) < 1.5
    assert not with_latitude[0].warnings
    assert "the latitude is not known" in without[0].warnings[0]
    wider = without[0].at_T0.standard.bias_dps / with_latitude[0].at_T0.standard.bias_dps
    assert (wider > 1.05).all()


def test_a_bias_that_changes_with_every_mounting_widens_the_uncertainty() -> None:
    shifts = np.random.default_rng(5).normal(0.0, 0.02, (6, 3))

    def moved() -> Iterator[Step]:
        for step in campaign(1):
            shift = shifts[AXIS_POSITIONS.index(step.info.mounting)]
            names = [f"rate_{axis}_dps" for axis in "xyz"]
            yield Step(step.info, {**step.channels, **{n: step[n] + s for n, s in zip(names, shift, strict=True)}})

    plain, wide = (fit_three_axes(steps, known()) for steps in (campaign(1), moved()))
    assert (wide.at_T0.standard.bias_dps > 4.0 * plain.at_T0.standard.bias_dps).all()


def test_samples_that_an_axis_does_not_state_and_gaps_cost_only_themselves() -> None:
    def torn() -> Iterator[Step]:
        for step in campaign(3):
            channels = {name: values.copy() for name, values in step.channels.items()}
            channels["rate_y_dps"][100:140] = np.nan
            channels["rate_x_dps"][100:140] = 1e6
            yield Step(step.info, {name: np.delete(values, slice(300, 380)) for name, values in channels.items()})

    result = fit_three_axes(torn(), known())
    assert np.abs(pulls(result)).max() < 4.0
    assert result.steps == len(AXIS_POSITIONS) * len(RATES_DPS)


@pytest.mark.parametrize(
    ("positions", "rates_dps"), [(("x up", "x down", "z up"), RATES_DPS), (UP, (0.0,)), (UP, (90.0,))]
)
def test_positions_or_rates_that_leave_the_matrix_open_are_refused(
    positions: Sequence[AxisPosition], rates_dps: Sequence[float]
) -> None:
    with pytest.raises(UsageError, match=f"expected each of x, y and z up or down.*found {', '.join(positions)}; run"):
        fit_three_axes(campaign(1, positions=positions, rates_dps=rates_dps), known())


def test_the_file_states_every_number_and_is_not_taken_for_that_of_one_axis(tmp_path: Path) -> None:
    path = tmp_path / "coefficients.json"
    result = fit_three_axes(campaign(1), known())
    write_coefficients(path, three_axes_coefficients(result, unit="SN-1", source=[("r.h5", "d")]))
    content = read_coefficients(path)
    parameters = content["uncertainty"]["parameters"]
    assert content["matrix"][0][1] == parameters["matrix_xy"]["value"]
    assert parameters["bias_z_dps"]["expanded"] == pytest.approx(result.at_T0.expanded.bias_dps[2])
    assert "matrix_per_c" not in content
    figures = {one.name: one.value for one in read_document(path, "coefficients").figures}  # of the unit's history
    assert figures == {one.name: one.value for one in result.parameters()}
    with pytest.raises(UsageError, match="coefficients of three axes have one law; leave out the choice of 'joint'"):
        read_compensation(path, "joint")


def corrected(path: Path, warmest_c: float = 45.0, count: int = 200) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rates about the axes, shape (3, n), the unit's outputs without noise, and temperatures, within the range."""
    write_coefficients(
        path,
        three_axes_coefficients(
            fit_three_axes(campaign(1, set_points_c=(0.0, warmest_c)), known()), unit="VG-7", source=[("r.h5", "d")]
        ),
    )
    chance = np.random.default_rng(2)
    rates, celsius = chance.uniform(-85.0, 85.0, (3, count)), chance.uniform(1.0, warmest_c - 1.0, count)
    return rates, UNIT.output_dps(rates.T, celsius).T, celsius


def test_apply_gives_the_true_rates_of_all_axes_at_any_temperature(tmp_path: Path) -> None:
    rates, outputs, celsius = corrected(tmp_path / "coefficients.json")
    outputs[1, 7], celsius[9] = np.nan, 60.0
    frames = {"frame_time_s": np.arange(200.0), "frame_temp_c": celsius, "frame_rate_dps": outputs[2]}
    frames |= {"frame_status": np.zeros(200), **dict(zip(AXIS_CHANNELS, outputs, strict=True))}
    write_recording(tmp_path / "r.h5", known(), [Step(info(1), frames)])
    done = compensate(tmp_path / "r.h5", tmp_path / "coefficients.json", tmp_path / "c.h5")
    assert str(done).splitlines()[0].endswith("200 samples compensated, matrix of three axes")
    assert (done.applied.outside, done.values()["law"], done.values()["delay_s"]) == (2, "three_axes", None)
    assert verify(done.recording) == []
    with open_recording(done.recording) as recording:
        step = recording.step(1)
        found = np.array([step[name] for name in AXIS_COMPENSATED])
        assert recording.meta.extra["channel_comments"][AXIS_COMPENSATED[0]].endswith("matrix of three axes")
    assert np.flatnonzero(step["frame_compensated_valid"] == 0.0).tolist() == [7, 9]
    assert np.isnan(found[:, 7]).all()
    inside = step["frame_compensated_valid"] == 1.0
    assert np.abs(found - rates)[:, inside].max() < 0.01
    assert np.abs(outputs - rates)[:, inside].max() > 0.2  # 20 times as much without the correction
    with pytest.raises(UsageError, match="has frame_compensated_x_dps already"):
        compensate(done.recording, tmp_path / "coefficients.json", tmp_path / "d.h5")


_PROGRAM = r"""
#include "gyro_compensation.h"
#include <stdio.h>
int main(void)
{
    double y[3], celsius, rate[3];
    printf("%d %s\n", gyro_self_test(), GYRO_UNIT_SERIAL);
    while (scanf("%lf %lf %lf %lf", y, y + 1, y + 2, &celsius) == 4) {
        gyro_rates_dps(y, celsius, rate);
        printf("%.17g %.17g %.17g %d\n", rate[0], rate[1], rate[2], gyro_rate_valid(rate[0], celsius));
    }
    return 0;
}
"""


@pytest.mark.parametrize("language", ["c", "c++"])
def test_the_c_header_agrees_with_python(language: str, tmp_path: Path) -> None:
    rates, outputs, celsius = corrected(tmp_path / "coefficients.json")
    compensation = own_compensation(tmp_path / "coefficients.json")
    export_c_header(compensation, tmp_path / "gyro_compensation.h")
    program = program_with(tmp_path, language, _PROGRAM)
    lines = "".join(f"{x:.17g} {y:.17g} {z:.17g} {c:.17g}\n" for x, y, z, c in zip(*outputs, celsius, strict=True))
    ran = subprocess.run([program], input=lines, capture_output=True, timeout=30, check=True, text=True)
    first, *rows = ran.stdout.splitlines()
    assert first == "0 VG-7"
    found = np.array([[float(word) for word in row.split()] for row in rows]).T
    np.testing.assert_allclose(found[:3], compensation.rates_dps(outputs, celsius), rtol=1e-12, atol=1e-11)
    assert np.abs(found[:3] - rates).max() < 0.01
    assert found[3].all()
    with pytest.raises(UsageError, match="json itself states `law` and its numbers"):
        export_json(compensation, tmp_path / "c.json")


def test_imucal_finds_the_same_matrix_in_the_same_samples() -> None:
    """imucal: the Ferraris calibration of the MaD lab. It has no Earth's rate, and takes bias and rotation from one
    rest and one whole turn in each position; its accelerometers are ideal here."""
    imucal = pytest.importorskip("imucal", reason="imucal is not installed")
    steps = list(campaign(7, rates_dps=(0.0, 36.0), latitude_deg=0.0, unit=replace(UNIT, arw_deg_per_sqrt_h=0.02)))
    still = fit_three_axes(steps, known(0.0))

    def of(position: str, kind: str) -> FloatArray:
        (step,) = (each for each in steps if (each.info.mounting, each.info.kind) == (position, kind))
        return np.column_stack([step[f"rate_{axis}_dps"] for axis in "xyz"])

    regions = {}
    for position, short in zip(AXIS_POSITIONS, ("x_p", "x_a", "y_p", "y_a", "z_a", "z_p"), strict=True):
        axis, sign = vertical(position)
        gravity = np.zeros((of(position, "static").shape[0], 3))
        gravity[:, axis] = 9.81 * sign
        regions |= {f"gyr_{short}": of(position, "static"), f"acc_{short}": gravity}
        if sign > 0:
            regions |= {f"gyr_{short[0]}_rot": of(position, "constant_rate"), f"acc_{short[0]}_rot": gravity}
    calibration = imucal.FerrarisCalibration(expected_angle=360.0).compute(
        imucal.ferraris_calibration.FerrarisSignalRegions(**regions),
        FRAMES_HZ,
        from_acc_unit="m/s^2",
        from_gyr_unit="dps",
    )
    theirs = calibration.K_g @ calibration.R_g
    # theirs is from one turn of ten seconds each; the Earth's rate, horizontal here, is 0.004 of 36 deg/s
    np.testing.assert_allclose(theirs, still.at_T0.value.matrix, rtol=0.0, atol=2e-4)
    np.testing.assert_allclose(calibration.b_g, still.at_T0.value.bias_dps, rtol=0.0, atol=EARTH_DPS)
    assert np.abs(theirs - np.eye(3)).max() > 10 * 2e-4
