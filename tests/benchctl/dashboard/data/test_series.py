"""Views of channels over a campaign's time: few samples one by one, many as lowest and highest of all of them."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchctl.dashboard.data import overviews, series, tracks
from benchctl.dashboard.data.cached import ENDING
from benchctl.dashboard.data.series import SeriesReader
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from tests.benchctl.dashboard.data import brute
from tests.benchctl.recordings import made
from tests.benchctl.recordings.open_folder import write_open
from tests.waiting import wait_until


@pytest.fixture
def reader(cache: Path) -> Iterator[SeriesReader]:
    with SeriesReader(cache) as one:
        yield one


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two thousand samples are many: overviews are made, and kept in files from five hundred on."""
    monkeypatch.setattr(series, "MOST_SAMPLES", 2000)
    monkeypatch.setattr(overviews, "_KEPT_FROM", 500)
    monkeypatch.setattr(tracks, "STRIDE", 1024)


def _all_of(path: Path, channel: str, axis: str = "time_s") -> tuple[FloatArray, FloatArray]:
    with open_recording(path) as recording:
        steps = [step for step in recording.steps() if channel in step.channels]
    steps.sort(key=lambda step: step.info.t_start)
    return np.concatenate([step[axis] for step in steps]), np.concatenate([step[channel] for step in steps])


def _complete(
    reader: SeriesReader, path: Path, channel: str, window: tuple[float, float], pixels: int
) -> dict[str, Any]:
    """A view once its overview is there."""
    for _ in range(500):
        found = reader.view(path, channel, *window, pixels)
        if found["complete"]:
            return found
        time.sleep(0.01)
    raise AssertionError("no overview within five seconds")


def _kept(cache: Path) -> Path:
    """The one overview's file, which gets its name after the overview is complete."""
    wait_until(lambda: bool(list((cache / "overviews").glob(f"*{ENDING}"))), 5.0, "no file within five seconds")
    (file,) = (cache / "overviews").glob(f"*{ENDING}")
    return file


def _large(folder: Path, **changes: Any) -> Path:
    """Four steps of 3000 samples, gaps of time between them."""
    path = folder / "large.h5"
    write_recording(path, made.meta(**changes), (made.step(index, rows=3000) for index in (1, 2, 3, 4)))
    return path


def test_few_samples_are_given_one_by_one(tmp_path: Path, reader: SeriesReader) -> None:
    path = made.recording(tmp_path)
    found = reader.view(path, "gyro_v", 100.5, 200.004, 400)
    time_s, values = _all_of(path, "gyro_v")
    inside = (time_s >= 100.5) & (time_s <= 200.004)
    assert found["t_s"] == time_s[inside].tolist()
    assert found["low"] == found["high"] == values[inside].tolist()
    assert (found["exact"], found["complete"], found["done"]) == (True, True, 1.0)
    assert (found["samples"], found["unit"], found["channel"]) == (np.count_nonzero(inside), "V", "gyro_v")


def test_an_open_interval_between_steps_holds_nothing(tmp_path: Path, reader: SeriesReader) -> None:
    found = reader.view(made.recording(tmp_path), "gyro_v", 120.0, 180.0, 100)
    assert (found["t_s"], found["low"], found["samples"], found["exact"]) == ([], [], 0, True)


def test_more_samples_become_the_lowest_and_highest_of_each_pixel(tmp_path: Path, reader: SeriesReader) -> None:
    path = _large(tmp_path)
    found = reader.view(path, "gyro_v", 90.0, 450.0, 100)
    assert not found["exact"]
    assert found["complete"]
    assert found["samples"] == 12_000
    brute.assert_is_of(found, *_all_of(path, "gyro_v"), 450.0)


@settings(
    deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(
    st.sampled_from(["gyro_v", "rate_dps", "encoder_deg"]),
    st.floats(80.0, 440.0),
    st.floats(0.001, 400.0),
    st.integers(1, 300),
)
def test_any_window_by_an_overview_is_that_of_all_samples(
    large: tuple[SeriesReader, Path], channel: str, from_s: float, width_s: float, pixels: int
) -> None:
    reader, path = large
    window = from_s, from_s + width_s
    found = _complete(reader, path, channel, window, pixels)
    time_s, values = _all_of(path, "encoder_deg" if channel == "rate_dps" else channel)
    if channel == "rate_dps":
        values = np.concatenate(
            [reader.view(path, channel, 100.0 * index, 100.0 * index + 30.0, 4000)["low"] for index in (1, 2, 3, 4)]
        ).astype(float)
    inside = np.count_nonzero((time_s >= window[0]) & (time_s <= window[1]))
    assert found["samples"] == inside
    assert found["exact"] == (inside <= 2 * pixels)
    if found["exact"]:
        assert found["low"] == values[(time_s >= window[0]) & (time_s <= window[1])].tolist()
    else:
        brute.assert_is_of(found, time_s, values, window[1])


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SeriesReader, Path]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(series, "MOST_SAMPLES", 2000)
        patch.setattr(overviews, "_KEPT_FROM", 500)
        patch.setattr(tracks, "STRIDE", 1024)
        with SeriesReader(tmp_path_factory.mktemp("cache")) as one:
            yield one, _large(tmp_path_factory.mktemp("large"))


@pytest.mark.usefixtures("few")
def test_while_an_overview_is_made_what_is_there_is_right_and_the_rest_is_none(
    tmp_path: Path, cache: Path, reader: SeriesReader
) -> None:
    path = _large(tmp_path)
    time_s, values = _all_of(path, "gyro_v")
    first = reader.view(path, "gyro_v", 90.0, 450.0, 100)
    assert (first["complete"], first["samples"]) == (False, 12_000)
    assert 0.0 <= first["done"] < 1.0
    low, high = brute.envelope(time_s, values, first["t_s"], 450.0)
    assert all(seen in (None, whole) for seen, whole in zip(first["low"], low, strict=True))
    assert all(seen in (None, whole) for seen, whole in zip(first["high"], high, strict=True))
    done = _complete(reader, path, "gyro_v", (90.0, 450.0), 100)
    assert done["done"] == 1.0
    brute.assert_is_of(done, time_s, values, 450.0)
    _kept(cache)


@pytest.mark.usefixtures("few")
def test_a_kept_overview_serves_at_once_and_a_damaged_one_is_made_anew(tmp_path: Path, cache: Path) -> None:
    path = _large(tmp_path)
    with SeriesReader(cache) as reader:
        _complete(reader, path, "gyro_v", (90.0, 450.0), 100)  # perhaps with the last samples read one by one
        file = _kept(cache)
        whole = reader.view(path, "gyro_v", 90.0, 450.0, 100)
    with SeriesReader(cache) as reader:
        assert reader.view(path, "gyro_v", 90.0, 450.0, 100) == whole
    file.write_bytes(file.read_bytes()[:-9])
    with SeriesReader(cache) as reader:
        assert not reader.view(path, "gyro_v", 90.0, 450.0, 100)["complete"]
        brute.assert_is_of(_complete(reader, path, "gyro_v", (90.0, 450.0), 100), *_all_of(path, "gyro_v"), 450.0)


@pytest.mark.usefixtures("few")
def test_an_overview_that_is_thrown_out_under_a_view_stays_right(
    tmp_path: Path, cache: Path, reader: SeriesReader
) -> None:
    path = _large(tmp_path)
    _complete(reader, path, "gyro_v", (90.0, 450.0), 100)
    _kept(cache).unlink()
    brute.assert_is_of(_complete(reader, path, "gyro_v", (90.0, 450.0), 100), *_all_of(path, "gyro_v"), 450.0)


@pytest.mark.usefixtures("few")
def test_a_recording_that_was_written_anew_is_read_anew(tmp_path: Path, reader: SeriesReader) -> None:
    path = _large(tmp_path)
    before = _complete(reader, path, "gyro_v", (90.0, 450.0), 100)
    write_recording(path, made.meta(), (made.step(index, rows=2900) for index in (1, 2, 3, 4)))
    after = _complete(reader, path, "gyro_v", (90.0, 450.0), 100)
    assert (before["samples"], after["samples"]) == (12_000, 11_600)
    brute.assert_is_of(after, *_all_of(path, "gyro_v"), 450.0)


@pytest.mark.usefixtures("few")
def test_prepared_overviews_are_there_without_anybody_having_looked(
    tmp_path: Path, cache: Path, reader: SeriesReader
) -> None:
    path = _large(tmp_path)
    reader.prepare(path)
    give_up_s = time.monotonic() + 10.0
    # gyro_v, gyro_temp_c, gyro_c, encoder_deg, rate_dps; polls are few
    while len(list((cache / "overviews").glob(f"*{ENDING}"))) < 5:
        assert time.monotonic() < give_up_s
        time.sleep(0.01)
    assert reader.view(path, "rate_dps", 90.0, 450.0, 100)["complete"]


@pytest.mark.usefixtures("few")
def test_where_the_cache_cannot_be_written_overviews_are_made_in_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    path = _large(tmp_path)
    with SeriesReader(tmp_path / "file") as reader:
        brute.assert_is_of(_complete(reader, path, "gyro_v", (90.0, 450.0), 50), *_all_of(path, "gyro_v"), 450.0)


@pytest.mark.usefixtures("few")
def test_a_damaged_channel_is_a_clear_line_and_the_others_are_drawn(tmp_path: Path, reader: SeriesReader) -> None:
    path = _large(tmp_path)
    with h5py.File(path) as file:
        place = file["steps/0003/gyro_v"].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[place : place + 500] = bytes(500)
    path.write_bytes(content)
    with pytest.raises(UsageError, match=r"chunk 0 is damaged; benchctl verify"):
        _complete(reader, path, "gyro_v", (90.0, 450.0), 100)
    assert _complete(reader, path, "encoder_deg", (90.0, 450.0), 100)["samples"] == 12_000


def test_a_running_campaign_is_seen_up_to_its_last_sample(tmp_path: Path, reader: SeriesReader) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = writer.begin_step(made.info(1), (*made.STREAMED, *made.POLLED))
    step.append(made.step(1).channels)
    step.close(made.info(1, t_start=100.0, t_end=102.0))
    going_on = writer.begin_step(made.info(2), made.STREAMED)
    going_on.append(made.streamed(200.0, 300))
    going_on.flush()
    found = reader.view(tmp_path / "c", "gyro_v", 0.0, 300.0, 1000)
    assert (found["samples"], found["t_s"][-1], found["complete"]) == (500, 202.99, True)
    going_on.append(made.streamed(203.0, 100))
    going_on.close(made.info(2, t_start=200.0, t_end=204.0))
    assert reader.view(tmp_path / "c", "gyro_v", 0.0, 300.0, 1000)["samples"] == 600
    writer.finish("complete")
    again = reader.view(tmp_path / "c", "gyro_v", 0.0, 300.0, 1000)
    time_s, values = _all_of(tmp_path / "c", "gyro_v")
    assert (again["t_s"], again["low"]) == (time_s.tolist(), values.tolist())


@pytest.mark.usefixtures("few")
def test_a_step_that_is_written_for_long_has_an_overview_that_grows(tmp_path: Path, reader: SeriesReader) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    for part in range(4):
        step.append(made.streamed(50.0 * part, 5000, seed=part))
        step.flush()
        for channel in ("gyro_v", "rate_dps"):
            found = _complete(reader, tmp_path / "c", channel, (0.0, 400.0), 50)
            assert found["samples"] == 5000 * (part + 1)
        time_s, values = _all_of(tmp_path / "c", "gyro_v")
        brute.assert_is_of(_complete(reader, tmp_path / "c", "gyro_v", (0.0, 400.0), 50), time_s, values, 400.0)
    writer.release()


def test_air_and_gyro_are_one_channel_wherever_steps_have_them(tmp_path: Path, reader: SeriesReader) -> None:
    polled = {
        "poll_time_s": np.array([1.0, 2.0]),
        "poll_chamber_temp_c": np.array([20.0, 21.0]),
        "poll_gyro_temp_c": np.array([19.0, 19.5]),
    }
    soak = Step(made.info(1, t_start=0.0, t_end=3.0, kind="soak", rate_dps=None), polled)
    path = tmp_path / "two.h5"
    write_recording(path, made.meta(), [soak, made.step(2, rows=2)])
    assert reader.view(path, "gyro_c", 0.0, 300.0, 10)["t_s"] == [1.0, 2.0, 200.0, 200.01]
    assert reader.view(path, "air_c", 0.0, 300.0, 10)["low"][:2] == [20.0, 21.0]
    assert reader.view(path, "poll_gyro_temp_c", 0.0, 300.0, 10)["t_s"] == [1.0, 2.0]


def test_an_open_recording_is_imported_once_into_the_cache(tmp_path: Path, cache: Path, reader: SeriesReader) -> None:
    folder = write_open(tmp_path / "open")
    found = reader.view(folder, "air_c", 0.0, 10.0, 100)
    assert found["low"] == [23.0] * 40
    assert len(list((cache / "imports").glob("*.h5"))) == 1
    assert reader.view(folder, "rate_dps", 0.0, 10.0, 100)["low"][20] == pytest.approx(20.0)
    assert sorted(path.name for path in folder.iterdir()) == ["recording.json", "samples.csv.gz"]


def test_frames_of_a_digital_gyro_lie_on_an_axis_of_their_own(tmp_path: Path, reader: SeriesReader) -> None:
    frames = {"frame_time_s": np.arange(5.0), "frame_rate_dps": np.arange(5.0) * 2.0}
    step = Step(made.info(1), {**made.streamed(0.0, 10), **frames})
    path = tmp_path / "frames.h5"
    write_recording(path, made.meta(), [step])
    found = reader.view(path, "frame_rate_dps", 0.0, 9.0, 10)
    assert (found["t_s"], found["low"], found["unit"]) == ([0, 1, 2, 3, 4], [0, 2, 4, 6, 8], "degree/s")


@pytest.mark.parametrize(
    ("channel", "from_s", "to_s", "pixels", "says"),
    [
        ("nothing", 0.0, 1.0, 10, "has no channel 'nothing'; it has rate_dps, air_c, gyro_c, encoder_deg"),
        ("time_s", 0.0, 1.0, 10, "has no channel 'time_s'"),
        ("gyro_v", 1.0, 1.0, 10, "a window from 1.0 to 1.0 s is none"),
        ("gyro_v", 0.0, float("nan"), 10, "is none"),
        ("gyro_v", 0.0, 1.0, 0, "0 pixels: expected 1 to 4000"),
        ("gyro_v", 0.0, 1.0, 4001, "4001 pixels"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_line(
    tmp_path: Path, reader: SeriesReader, channel: str, from_s: float, to_s: float, pixels: int, says: str
) -> None:
    with pytest.raises(UsageError, match=says):
        reader.view(made.recording(tmp_path), channel, from_s, to_s, pixels)


def test_a_closed_reader_stops_what_it_was_making(tmp_path: Path, cache: Path, few: None) -> None:
    reader = SeriesReader(cache)
    reader.prepare(_large(tmp_path))
    reader.close()
    reader.close()
    assert list(cache.glob("overviews/*.tmp")) == []
