"""`benchctl diagnose` on what cannot be diagnosed, or only in part: a clear line or an honest limit, never a guess."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.cli.app import run_verb
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.diagnosis.moving import SIMULATION, write_moving

REST = ("static", "static", "static")


def diagnosed(path: Path, *more: str | Path) -> dict[str, Any]:
    """What a diagnosis says to programs."""
    arguments = ["diagnose", path, "--json", path.with_suffix(".json"), "--quiet", *more]
    assert run_verb([str(argument) for argument in arguments]) == 0
    return dict(json.loads(path.with_suffix(".json").read_text()))


def refused(capsys: pytest.CaptureFixture[str], path: Path, *more: str | Path) -> str:
    """The one line with which a recording is refused."""
    before = sorted(path.parent.iterdir())
    assert run_verb([str(argument) for argument in ("diagnose", path, *more)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert sorted(path.parent.iterdir()) == before
    return line


def changed(path: Path, change: Callable[[Meta, list[Step]], tuple[Meta, list[Step]]]) -> Path:
    """The recording of a file with something changed, in another file."""
    with open_recording(path) as recording:
        meta, steps = change(recording.meta, list(recording.steps()))
    other = path.with_name("changed.h5")
    write_recording(other, meta, steps)
    return other


def with_channel(step: Step, **channels: Any) -> Step:
    """The step with other channels; None: without it."""
    kept = {name: values for name, values in {**step.channels, **channels}.items() if values is not None}
    return Step(step.info, kept)


def test_a_recording_that_is_too_short_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, write_moving(tmp_path / "short.h5", kinds=("sine",)))
    assert "1600 samples with motion and output are too few" in line
    assert "needs 2000 or more" in line


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("mode-hop.py", "named after the file"),
        ("hop.txt", "named after the file"),
        ("thermal_lag.py", "there is an effect"),
    ],
)
def test_an_effect_s_file_of_a_name_that_no_effect_can_have_is_refused(
    name: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in refused(capsys, write_moving(tmp_path / "r.h5"), "--write-effect", tmp_path / name)


def test_without_scans_the_line_says_what_there_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def only_polls(meta: Meta, steps: list[Step]) -> tuple[Meta, list[Step]]:
        times = np.arange(0.0, 20.0, 5.0)
        info = StepInfo(index=1, name="soak", kind="soak", t_start=0.0, t_end=20.0, chamber_setpoint_c=23.0)
        return meta, [Step(info, {"poll_time_s": times, "poll_chamber_temp_c": np.full(times.size, 23.0)})]

    line = refused(capsys, changed(write_moving(tmp_path / "moving.h5"), only_polls))
    assert "needs steps with the channels time_s, encoder_deg, gyro_v in one scan" in line
    assert "poll_chamber_temp_c" in line


def test_a_table_that_never_turns_needs_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, write_moving(tmp_path / "bare.h5", simulation=None, kinds=("static",) * 3))
    assert "name a model with --model FILE" in line


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("k_T", None, "k_T: expected a list"),
        ("k_omega", ["fast"], "k_omega: expected a finite number, got 'fast'"),
        ("K0_v_per_dps", 0.0, "K0_v_per_dps: expected a number other than 0"),
        ("U0_v", "12 mV", "U0_v: expected a finite number, got '12 mV'"),
        ("output_limit_v", -1.0, "output_limit_v: expected a number above 0"),
    ],
)
def test_a_recordings_own_model_with_a_wrong_field_is_named(
    field: str, value: object, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(capsys, write_moving(tmp_path / "odd.h5", simulation={**SIMULATION, field: value}))
    assert "[simulation]" in line
    assert says in line


def test_a_recordings_own_model_without_a_field_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = {name: value for name, value in SIMULATION.items() if name != "T0_c"}
    assert "T0_c is missing" in refused(capsys, write_moving(tmp_path / "odd.h5", simulation=told))


def test_a_model_file_with_a_wrong_field_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "lab.toml").write_text("[simulation]\nK0 = 0.02\n", encoding="utf-8")
    recording = write_moving(tmp_path / "moving.h5")
    line = refused(capsys, recording, "--model", tmp_path / "lab.toml")
    assert str(tmp_path / "lab.toml") in line
    assert "K0" in line


def test_volts_are_not_taken_for_a_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def digital(meta: Meta, steps: list[Step]) -> tuple[Meta, list[Step]]:
        return replace(meta, extra={**meta.extra, "gyro_output_unit": "deg/s"}), steps

    line = refused(capsys, changed(write_moving(tmp_path / "moving.h5"), digital))
    assert "K0_v_per_dps = 0.02, but the gyro's output was recorded in deg/s" in line


def test_stamps_of_no_clock_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def shaken(meta: Meta, steps: list[Step]) -> tuple[Meta, list[Step]]:
        chance = np.random.default_rng(1)
        late = [0.0005 * chance.integers(0, 4, step["time_s"].size) for step in steps]
        return meta, [with_channel(s, time_s=s["time_s"] + d) for s, d in zip(steps, late, strict=True)]

    line = refused(capsys, changed(write_moving(tmp_path / "moving.h5"), shaken))
    assert "of the stamps are not 5 ms after the one before" in line


@pytest.mark.parametrize("channel", ["encoder_deg", "gyro_temp_c"])
def test_what_is_not_a_number_is_named_with_its_place(
    channel: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(meta: Meta, steps: list[Step]) -> tuple[Meta, list[Step]]:
        values = steps[1][channel].copy()
        values[17] = np.nan
        return meta, [steps[0], with_channel(steps[1], **{channel: values}), *steps[2:]]

    line = refused(capsys, changed(write_moving(tmp_path / "moving.h5"), broken))
    assert f"step 2 (constant_rate at +23): {channel} is nan at sample 17" in line


def test_a_table_that_never_turns_says_nothing_of_the_scale_factor(tmp_path: Path) -> None:
    told = diagnosed(write_moving(tmp_path / "rest.h5", kinds=REST))
    assert told["verdict"] == "consistent"
    scale = told["baseline"]["parameters"]["K0_v_per_dps"]
    assert (scale["value"], scale["ci95"]) == (SIMULATION["K0_v_per_dps"], [None, None])
    assert any("The table never turns in this recording" in note for note in told["notes"])
    (unseen,) = (note for note in told["notes"] if note.startswith("Not observable in this recording: "))
    for effect in ("rate_nonlinearity", "scale_asymmetry", "timing_offset", "angular_acceleration"):
        assert f"{effect} (" in unseen


def test_one_temperature_and_no_rest_are_said_to_show_nothing_of_theirs(tmp_path: Path) -> None:
    told = diagnosed(write_moving(tmp_path / "warm.h5", kinds=("constant_rate", "sine")))
    assert told["findings"] == []
    assert any("The gyro's temperature changes by 0 °C in all" in note for note in told["notes"])
    assert any("The table never rests in this recording" in note for note in told["notes"])
    (unseen,) = (note for note in told["notes"] if note.startswith("Not observable in this recording: "))
    for effect in ("bias_temperature", "bias_temperature_rate", "scale_temperature", "supply_sensitivity"):
        assert f"{effect} (" in unseen


def test_without_a_thermistor_the_gyro_is_taken_to_be_at_its_reference(tmp_path: Path) -> None:
    def bare(meta: Meta, steps: list[Step]) -> tuple[Meta, list[Step]]:
        return meta, [with_channel(step, gyro_temp_c=None) for step in steps]

    told = diagnosed(changed(write_moving(tmp_path / "moving.h5"), bare))
    assert told["findings"] == []
    assert any("No temperature was recorded" in note for note in told["notes"])


def points(path: Path, rates: Mapping[float, int]) -> Path:
    """A recording of so many points at each rate, made from a table."""
    rows = [f"{rate},{0.01 + 0.02 * rate}" for rate, count in rates.items() for _ in range(count)]
    table = path.with_suffix(".csv")
    table.write_text("rate_dps,gyro_v_mean\n" + "\n".join(rows) + "\n", encoding="utf-8")
    assert run_verb(["import", str(table), "-o", str(path), "--quiet"]) == 0
    return path


def test_too_few_static_points_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, points(tmp_path / "points.h5", {-10.0: 5, 10.0: 5}))
    assert "10 static points at 2 rates are too few" in line
