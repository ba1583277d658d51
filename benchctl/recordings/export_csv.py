"""Writes a recording as CSV: one file a step and time axis, and `recording.json` with all that is not a sample."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_folder
from benchctl.recordings.model import Axis, Step, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.schema import unit_of
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.text_rows import csv_rows

FORMAT = "benchctl-csv/1"
OF_SOME = ("frame_rate_hz", "frames_lost", "frames_bad", "mounting")
"""What only steps with a digital gyro have, or of a unit mounted across."""

_SUFFIXES: Mapping[Axis, str] = {"time_s": ".csv", "poll_time_s": "_polled.csv", "frame_time_s": "_frames.csv"}


def export_csv(recording: Recording, folder: Path) -> None:
    """Write `0001_name.csv` (the scans), `0001_name_polled.csv` (the polls) for each step, and `recording.json`.

    The frames of a digital gyro go to `0001_name_frames.csv`.

    The first line names the channels, units are in `recording.json`. Numbers give back the same float64 when they are
    read. Raises `UsageError` where the folder exists and holds something, or the disk refuses.
    """
    decimals = recording.meta.extra.get("csv_decimals")
    with whole_folder(folder) as temporary:
        steps = []
        for step in recording.steps():
            files = [_write_axis(step, axis, temporary, decimals) for axis in _SUFFIXES]
            described = {
                key: value for key, value in asdict(step.info).items() if key not in OF_SOME or value not in (None, "")
            }
            steps.append({**described, "files": [name for name in files if name]})
        names = dict.fromkeys(name for info in recording.infos for name in recording.channels(info.index))
        description = {
            "format": FORMAT,
            "digest": recording.digest,
            **asdict(recording.meta),
            "units": {name: unit_of(name, recording.meta) for name in names},
            "steps": steps,
        }
        text = json.dumps(without_nan(description), indent=1, ensure_ascii=False)
        (temporary / "recording.json").write_text(text + "\n", encoding="utf-8")


def without_nan(value: Any) -> Any:
    """The same with None for every number that JSON cannot write."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write_axis(step: Step, axis: Axis, folder: Path, decimals: Mapping[str, int] | None) -> str:
    """Write the channels of one time axis, the axis first; returns the name of the file, empty where there are none."""
    names = sorted((name for name in step.channels if axis_of(name) == axis), key=lambda name: name != axis)
    if not names:
        return ""
    path = folder / f"{file_stem(step.info)}{_SUFFIXES[axis]}"
    with path.open("wb") as file:
        file.write((",".join(names) + "\n").encode())
        for lines in csv_rows([step[name] for name in names], names, decimals):
            file.write(lines)
    return path.name
