"""Even series out of recordings and text files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.metrology.series import series_of_step, series_of_text
from benchctl.recordings import stored
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.reader import Recording, StepsInMemory
from benchctl_instruments.errors import UsageError

RATES = np.sin(np.arange(200.0))


def written(path: Path, *columns: np.ndarray[tuple[int], np.dtype[np.float64]], header: str = "") -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.17g")
    return path


@pytest.mark.parametrize(
    ("header", "unit"),
    [("rate_dps", "deg/s"), ("rate [deg/s]", "deg/s"), ("output_v", "V"), ("counts", "1"), ("", "1")],
)
def test_the_only_column_is_taken_and_its_unit_read_off_its_name(header: str, unit: str, tmp_path: Path) -> None:
    series = series_of_text(written(tmp_path / "a.csv", RATES, header=header), None, 50.0)
    assert np.array_equal(series.values, RATES)
    assert (series.interval_s, series.unit) == (0.02, unit)


def test_a_column_of_time_says_how_often_it_was_sampled(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", 5.0 + 0.01 * np.arange(200), RATES, header="time_s,rate_dps")
    series = series_of_text(path, None, None)
    assert series.interval_s == pytest.approx(0.01)
    assert np.array_equal(series.values, RATES)


def test_of_a_series_with_a_gap_the_longest_stretch_is_taken_and_said(tmp_path: Path) -> None:
    time_s = 0.01 * np.arange(200.0)
    time_s[50:] += 1.0
    series = series_of_text(written(tmp_path / "a.csv", time_s, RATES, header="time_s,rate_dps"), None, None)
    assert np.array_equal(series.values, RATES[50:])
    assert series.interval_s == pytest.approx(0.01)
    assert "the longest stretch between 1 gaps" in series.source


@pytest.mark.parametrize(
    ("header", "channel", "rate_hz", "says"),
    [
        ("a,b", None, 1.0, r"a.csv: has the columns 'a', 'b'; name one with --channel"),
        ("a,b", "c", 1.0, r"a.csv: has no column 'c'; it has 'a', 'b'"),
        ("a,b", "a", None, r"a.csv: has no column of time; say how often it was sampled with --rate-hz"),
        ("time_s,b", None, None, r"a.csv: expected at least 3 samples, at times that grow"),
    ],
)
def test_what_cannot_be_taken_is_said_with_what_there_is(
    header: str, channel: str | None, rate_hz: float | None, says: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "a.csv", RATES, RATES, header=header)
    with pytest.raises(UsageError, match=says):
        series_of_text(path, channel, rate_hz)


def recording(*steps: Step, simulation: dict[str, float] | None = None, **extra: str) -> Recording:
    meta = Meta(
        status="complete",
        unit=Unit(serial="1", range_dps=100.0),
        bench=BenchFacts(sample_rate_hz=100.0),
        simulation=simulation,
        extra=extra,
    )
    return Recording(Path("r.h5"), meta, [step.info for step in steps], StepsInMemory(list(steps)))


def step(index: int, kind: str, duration_s: float, whole: bool = True) -> Step:
    time_s = np.arange(0.0, duration_s, 0.01)
    info = StepInfo(
        index=index,
        name=f"{kind} {index}",
        kind=kind,
        t_start=0.0,
        t_end=duration_s,
        chamber_setpoint_c=20,
        whole=whole,
    )
    return Step(info, {"time_s": time_s, "gyro_v": np.sin(time_s) + index})


def test_the_longest_whole_static_step_is_taken_and_its_volts_become_a_rate() -> None:
    held = recording(
        step(1, "static", 3.0),
        step(2, "static", 5.0),
        step(3, "static", 9.0, whole=False),
        step(4, "sine", 20.0),
        simulation={"K0_v_per_dps": -0.05},
    )
    series = series_of_step(held, None, None)
    assert series.values == pytest.approx(held.step(2)["gyro_v"] / 0.05)
    assert (series.unit, series.interval_s) == ("deg/s", pytest.approx(0.01))
    assert series.source == "gyro_v of step 'static 2', as a rate by 0.05 V/(deg/s)"


def test_a_unit_mounted_across_is_not_taken_unless_its_step_is_named() -> None:
    longer = step(2, "static", 9.0)
    held = recording(step(1, "static", 3.0), Step(replace(longer.info, mounting="across"), longer.channels))
    assert series_of_step(held, None, None).values.size == 300
    assert series_of_step(held, None, "2").values.size == 900


def test_a_stated_scale_factor_goes_before_the_recordings_own_and_for_volts_only() -> None:
    held = recording(step(1, "static", 3.0), simulation={"K0_v_per_dps": 0.05})
    assert series_of_step(held, None, None, 0.1).values == pytest.approx(held.step(1)["gyro_v"] / 0.1)
    with pytest.raises(UsageError, match="'gyro_v' is in deg/s, a scale factor is for gyro_v in V; leave"):
        series_of_step(recording(step(1, "static", 3.0), gyro_output_unit="deg/s"), None, None, 0.1)


def test_without_a_scale_factor_the_output_stays_in_its_unit() -> None:
    assert series_of_step(recording(step(1, "static", 3.0)), None, None).unit == "V"
    held = recording(step(1, "static", 3.0), gyro_output_unit="deg/s")
    assert series_of_step(held, None, "static 1").unit == "deg/s"


@pytest.mark.parametrize(
    ("channel", "name", "says"),
    [
        ("gyro_mv", None, "step 'static 1': has no channel 'gyro_mv'; did you mean gyro_v?"),
        (None, "9", "has no step '9'; `benchctl show` lists them"),
        ("time_s", None, "has no channel 'time_s'"),
    ],
)
def test_a_step_or_channel_that_is_not_there_is_said(channel: str | None, name: str | None, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        series_of_step(recording(step(1, "static", 3.0)), channel, name)


def test_a_recording_without_a_static_step_asks_for_one() -> None:
    with pytest.raises(UsageError, match="has no complete static step; name a step with --step"):
        series_of_step(recording(step(1, "sine", 3.0)), None, None)


@pytest.mark.parametrize("scans_at_once", [40, 128, 1 << 18])
@pytest.mark.parametrize(("gap_at", "kept"), [(None, slice(None)), (127, slice(127, None)), (128, slice(128, None))])
def test_a_step_is_the_same_series_however_it_is_read(
    scans_at_once: int, gap_at: int | None, kept: slice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stored, "SCANS_AT_ONCE", scans_at_once)
    made = step(1, "static", 3.0)
    if gap_at is not None:
        made["time_s"][gap_at:] += 0.02
    series = series_of_step(recording(made), None, None, 0.1)
    assert np.array_equal(series.values, made["gyro_v"][kept] / 0.1)
    assert series.interval_s == pytest.approx(0.01)
    assert ("gaps" in series.source) == (gap_at is not None)


@pytest.mark.parametrize("stamp", [0, 63, 64, 65, 299])
def test_a_stamp_that_is_no_number_is_found_in_any_part(stamp: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stored, "SCANS_AT_ONCE", 64)
    made = step(1, "static", 3.0)
    made["time_s"][stamp] = np.nan
    with pytest.raises(UsageError, match="at times that grow; correct its stamps"):
        series_of_step(recording(made), None, None)
