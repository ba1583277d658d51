"""10,000 points recorded one by one, a stamp and three channels each: ours, and six other ways on the same points.

Two times are taken: of the points alone, until the last of them is in the file, and of the whole, from opening to
closing; ours is then a sealed, compressed step on the disk. What a `kill -9` costs differs: ours half a second at most,
PyMeasure, bluesky and h5py with a flush a row nothing, QCoDeS up to five seconds, OpenHTF and h5py without a flush
everything. How old the oldest point is that is lost with us is measured, too.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from tests.benchctl.recordings import made as recordings
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.peers import bluesky_jsonl, h5py_by_hand, openhtf_json, pymeasure_csv, qcodes_sqlite
from tests.benchmarks.peers.points import NAMES, Point, Recorder, Spent, made

POINTS = 10_000
LIMIT_US = 5.0
LIMIT_LOST_S = 0.5
OTHERS: dict[str, Recorder] = {
    "bluesky, JSON lines": bluesky_jsonl.record,
    "OpenHTF, JSON": openhtf_json.record,
    "QCoDeS, SQLite": qcodes_sqlite.record,
    "h5py, a row at a time": h5py_by_hand.record,
    "h5py, a flush a row": h5py_by_hand.record_flushed,
}
_TURNS, _TURNS_OF_OTHERS, _KILLS = 11, 3, 3
_ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class MicroSeconds:
    """A point's share of the points alone, and of the whole."""

    points: float
    whole: float


def measured() -> list[Comparison]:
    """A point of ours beside PyMeasure's, the limit and the others', and what a kill costs."""
    points = made(POINTS)
    ours, theirs = _in_turns(points, pymeasure_csv.record, _TURNS)
    found = [
        Comparison("a point in the file", ours.points, "µs", "PyMeasure, CSV", theirs.points, "<=", 1.0),
        Comparison("a point in the file", ours.points, "µs", "limit", LIMIT_US, "<=", 1.0),
        Comparison("a point, opened to closed", ours.whole, "µs", "PyMeasure, CSV", theirs.whole, "<=", 1.0),
        Comparison("a point, opened to closed", ours.whole, "µs", "limit", LIMIT_US, "<=", 1.0),
    ]
    for name, other in OTHERS.items():
        ours, theirs = _in_turns(points, other, _TURNS_OF_OTHERS)
        found.append(Comparison("a point, opened to closed", ours.whole, "µs", name, theirs.whole, "<=", 1.0))
    return [*found, Comparison("points lost by kill -9", lost_s(), "s", "limit", LIMIT_LOST_S, "<=", 1.0)]


def record(points: Sequence[Point], folder: Path) -> Spent:
    """Ours: one step of a campaign."""
    writer = CampaignWriter(folder / "campaign", recordings.meta(status="running"))
    began_s = time.perf_counter()
    step = writer.begin_step(recordings.info(1), NAMES)
    first_s = time.perf_counter()
    for time_s, encoder_deg, gyro_v, gyro_temp_c in points:
        step.append_point({"time_s": time_s, "encoder_deg": encoder_deg, "gyro_v": gyro_v, "gyro_temp_c": gyro_temp_c})
    step.flush()
    points_s = time.perf_counter() - first_s
    stored = step.close(recordings.info(1)).samples
    whole_s = time.perf_counter() - began_s
    writer.release()
    return Spent(points_s, whole_s, stored)


def lost_s() -> float:
    """How old the oldest point is that a killed process takes with it [s]; the worst of several."""
    worst = 0.0
    for turn in range(_KILLS):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "campaign"
            command = [sys.executable, "-m", "tests.benchctl.recordings.writing_process", str(folder), "points", "0"]
            with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=_ROOT) as process:
                assert process.stdout is not None
                process.stdout.readline()
                time.sleep(1.0 + turn / 10.0)
                killed_s = time.monotonic()
                process.kill()
            with open_recording(recover(folder).recording) as recording:
                worst = max(worst, killed_s - float(recording.step(1)["time_s"][-1]))
    return worst


def _in_turns(points: Sequence[Point], peer: Recorder, turns: int) -> tuple[MicroSeconds, MicroSeconds]:
    """Ours and a peer's, by turns: the medians."""
    pairs = [(_recorded(record, points), _recorded(peer, points)) for _ in range(turns)]
    ours, theirs = ([pair[side] for pair in pairs] for side in (0, 1))
    return _median(ours), _median(theirs)


def _recorded(by: Recorder, points: Sequence[Point]) -> Spent:
    with tempfile.TemporaryDirectory() as folder:
        spent = by(points, Path(folder))
    if spent.stored != len(points):
        raise RuntimeError(f"{by} kept {spent.stored} of {len(points)} points: its time means nothing")
    return spent


def _median(turns: Sequence[Spent]) -> MicroSeconds:
    return MicroSeconds(
        points=1e6 * statistics.median(spent.points_s for spent in turns) / POINTS,
        whole=1e6 * statistics.median(spent.whole_s for spent in turns) / POINTS,
    )
