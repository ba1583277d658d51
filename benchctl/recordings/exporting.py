"""Export a recording as CSV, as a MATLAB file, as netCDF, or as an open recording.

CSV has one file per step and time axis, and `recording.json` with everything that is not a sample. The MATLAB file has
version 5, which every MATLAB and Octave loads.

An open recording consists of `samples.csv.gz` and `recording.json`. The format requires one uniform clock without gaps.
An imported open recording has such a clock, keeps its stamps, and is exported with its original digits. A campaign of
benchctl has soaks, and therefore gaps: its streamed stretches get new stamps, one after the other from zero, and
nothing is resampled. Each step then states its original start as `original_t_start`, and `restamped` marks the
recording. A stretch ends at the end of its step, or at a gap in the stream, which divides one step into several (`name,
part 2`). The table's motion between two stretches is not known: no fit may continue from one step to the next.
"""

from __future__ import annotations

import gzip
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from benchctl.atomic import whole_file, whole_folder
from benchctl.documents import json_values
from benchctl.recordings.model import Axis, Meta, Step, StepInfo, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import gap_free
from benchctl.recordings.schema import unit_of
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.text_file import csv_rows
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

COLUMNS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", "chamber_temp_c")
KINDS = ("static", "constant_rate", "sine", "thermal_ramp", "motion")
"""Kinds of steps that are listed; the rows of other steps are kept and belong to no step."""

_CLOCK_TOLERANCE = 1e-3
"""Maximum distance of a stamp from the uniform clock, in periods."""
_NEW_STAMP_DECIMALS = 9


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Samples of one step without a gap: from `first` to before `last`; they begin at row `row` of the file.

    `start_s` is the recorded stamp of the first sample.
    """

    info: StepInfo
    part: int
    parts: int
    first: int
    last: int
    row: int
    start_s: float

    @property
    def rows(self) -> int:
        return self.last - self.first


def export_open(recording: Recording, folder: Path) -> None:
    """Write an open recording to a folder, which must be absent or empty. The bytes depend on the recording alone.

    If the chamber (or the gyro's thermistor) was only polled, its column is interpolated linearly between the polls.

    Raises
    ------
    UsageError
        The folder is not empty; no step was streamed; steps have different rates; a step lacks a column that the
        format needs, or has a sample that is not a finite number.
    """
    rate_hz = _rate_of(recording)
    stretches = _stretches_of(recording, rate_hz)
    decimals = dict(recording.meta.extra.get("csv_decimals", {}))
    restamped = not _is_one_clock(stretches, rate_hz, decimals.get("time_s"))
    if restamped:
        decimals["time_s"] = _NEW_STAMP_DECIMALS
    names = recording.meta.extra.get("csv_columns", COLUMNS)
    with whole_folder(folder) as temporary:
        description = _description(recording, stretches, rate_hz, restamped)
        text = json.dumps(description, indent=1, ensure_ascii=False)
        (temporary / "recording.json").write_text(text + "\n", encoding="utf-8")
        # Neither a name nor a time in the header: the same recording gives the same bytes.
        with (
            (temporary / "samples.csv.gz").open("wb") as raw,
            gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0, compresslevel=4) as file,
        ):
            file.write((",".join(names) + "\n").encode())
            for info in dict.fromkeys(stretch.info for stretch in stretches):
                step = recording.step(info.index)
                for stretch in (stretch for stretch in stretches if stretch.info is info):
                    stamps = (stretch.row + np.arange(stretch.rows)) / rate_hz if restamped else None
                    for lines in csv_rows(_columns(step, stretch, names, stamps), names, decimals):
                        file.write(lines)


def _rate_of(recording: Recording) -> float:
    """Return the one rate of all streamed steps."""
    rates = {
        info.sample_rate_hz or recording.meta.bench.sample_rate_hz: info for info in recording.infos if info.samples
    }
    if not rates:
        raise UsageError(
            f"{recording.path}: no step was streamed, there is nothing that an open recording "
            "could hold; export to csv, mat or netcdf"
        )
    low, high = min(rates), max(rates)
    if not low > 0 or high - low > 1e-6 * low:
        raise UsageError(
            f"{recording.path}: an open recording has one sample rate, step {rates[low].index} has {low:g} Hz "
            f"and step {rates[high].index} has {high:g} Hz; export to csv, mat or netcdf instead"
        )
    return low


def _stretches_of(recording: Recording, rate_hz: float) -> list[_Stretch]:
    """Return all stretches without a gap, in order of time."""
    found = []
    row = 0
    for info in sorted((info for info in recording.infos if info.samples), key=lambda info: info.t_start):
        time_s = recording.step(info.index, ["time_s"])["time_s"]
        runs = gap_free(time_s, 1.0 / rate_hz)
        for part, run in enumerate(runs, 1):
            found.append(_Stretch(info, part, len(runs), run.start, run.stop, row, float(time_s[run.start])))
            row += run.stop - run.start
    return found


def _is_one_clock(stretches: Sequence[_Stretch], rate_hz: float, decimals: int | None) -> bool:
    """Whether the recorded stamps of all stretches already follow one uniform clock, within the printed digits."""
    origin = stretches[0].start_s
    allowed = _CLOCK_TOLERANCE / rate_hz + (10.0**-decimals if decimals is not None else 0.0)
    return all(abs(stretch.start_s - origin - stretch.row / rate_hz) <= allowed for stretch in stretches)


def _columns(step: Step, stretch: _Stretch, names: Sequence[str], stamps_s: FloatArray | None) -> list[FloatArray]:
    """Return the columns of a stretch, each of shape (rows,)."""
    columns = []
    for name in names:
        if name == "time_s" and stamps_s is not None:
            columns.append(stamps_s)
            continue
        samples = _column(step, name)[stretch.first : stretch.last]
        if not np.isfinite(samples).all():
            raise UsageError(
                f"step {step.info.index} {step.info.name!r}, {name}: holds samples that are no numbers, which an open "
                "recording cannot; export to csv, mat or netcdf instead"
            )
        columns.append(samples)
    return columns


def _column(step: Step, name: str) -> FloatArray:
    """Return a channel at the rate of the scans; a channel that was only polled is interpolated linearly."""
    if name in step.channels:
        return step[name]
    polled = f"poll_{name}"
    if polled in step.channels and step[polled].size:
        return np.interp(step["time_s"], step["poll_time_s"], step[polled])
    raise UsageError(
        f"step {step.info.index} {step.info.name!r} has no {name}, streamed or polled, which an open recording "
        "needs; export to csv, mat or netcdf instead"
    )


def _description(
    recording: Recording, stretches: Sequence[_Stretch], rate_hz: float, restamped: bool
) -> dict[str, Any]:
    """Return the content of `recording.json`; keys that an import stored under `foreign_keys` return to their place."""
    meta = recording.meta
    foreign: Mapping[str, Any] = meta.extra.get("foreign_keys", {})
    note = {"restamped": "steps put one after the other, see original_t_start", "source_digest": recording.digest}
    return {
        "format": "open-recording/1",
        "unit": {**_unit(meta), **foreign.get("unit", {})},
        "bench": {**_bench(meta, rate_hz), **foreign.get("bench", {})},
        "simulation": meta.simulation,
        "steps": [
            {**_step(stretch, rate_hz, restamped), **foreign.get("steps", {}).get(str(stretch.info.index), {})}
            for stretch in stretches
            if stretch.info.kind in KINDS
        ],
        **foreign.get("recording", {}),
        **(note if restamped else {}),
    }


def _unit(meta: Meta) -> dict[str, Any]:
    return {
        "serial": meta.unit.serial,
        "range_dps": meta.unit.range_dps,
        **({"model": meta.unit.model} if meta.unit.model else {}),
    }


def _bench(meta: Meta, rate_hz: float) -> dict[str, Any]:
    keys = ("encoder_counts_per_rev", "adc_bits", "adc_range_v", "latitude_deg")
    return {"sample_rate_hz": rate_hz, **{key: getattr(meta.bench, key) for key in keys}}


def _step(stretch: _Stretch, rate_hz: float, restamped: bool) -> dict[str, Any]:
    info = stretch.info
    begin_s, end_s = info.t_start, info.t_end
    if not info.whole:  # interrupted: it began before its first sample and ended after its last
        begin_s, end_s = stretch.start_s, stretch.start_s + stretch.rows / rate_hz
    entry: dict[str, Any] = {
        "name": info.name if stretch.parts == 1 else f"{info.name}, part {stretch.part}",
        "kind": info.kind,
        "t_start": stretch.row / rate_hz if restamped else begin_s,
        "t_end": (stretch.row + stretch.rows) / rate_hz if restamped else end_s,
        "chamber_setpoint_c": None if math.isnan(info.chamber_setpoint_c) else info.chamber_setpoint_c,
    }
    optional = {
        "rate_dps": info.rate_dps,
        "amplitude_dps": info.amplitude_dps,
        "frequency_hz": info.frequency_hz,
        "role": None if info.role == "fit" else info.role,
        "whole": None if info.whole else False,
        "mounting": info.mounting or None,
        "original_t_start": stretch.start_s if restamped else None,
    }
    return entry | {key: value for key, value in optional.items() if value is not None}


FORMAT = "benchctl-csv/1"
OF_SOME = ("frame_rate_hz", "frames_lost", "frames_bad", "mounting")
"""Fields of steps with a digital gyro only, or of a unit mounted across."""

_SUFFIXES: Mapping[Axis, str] = {"time_s": ".csv", "poll_time_s": "_polled.csv", "frame_time_s": "_frames.csv"}


def export_csv(recording: Recording, folder: Path) -> None:
    """Write `0001_name.csv` (scans) and `0001_name_polled.csv` (polls) for each step, and `recording.json`.

    The frames of a digital gyro are written to `0001_name_frames.csv`.

    The first line names the channels, units are in `recording.json`. Numbers give the same float64 when they are read.
    Raises `UsageError` if the folder exists and is not empty, or the disk refuses.
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
        text = json.dumps(json_values(description), indent=1, ensure_ascii=False)
        (temporary / "recording.json").write_text(text + "\n", encoding="utf-8")


def _write_axis(step: Step, axis: Axis, folder: Path, decimals: Mapping[str, int] | None) -> str:
    """Write the channels of one time axis, the axis first; return the file name, empty if there are no channels."""
    names = sorted((name for name in step.channels if axis_of(name) == axis), key=lambda name: name != axis)
    if not names:
        return ""
    path = folder / f"{file_stem(step.info)}{_SUFFIXES[axis]}"
    with path.open("wb") as file:
        file.write((",".join(names) + "\n").encode())
        for lines in csv_rows([step[name] for name in names], names, decimals):
            file.write(lines)
    return path.name


_LARGEST = 2**31 - 1
"""Maximum size in bytes of one variable in this file format."""


def export_mat(recording: Recording, path: Path) -> None:
    """Write a struct `recording` with everything that is not a sample, and one struct `step_0001` per step.

    A step's fields are its description and its channels, columns of shape (n, 1); `recording.units` contains their
    units. Values that are not known are left out. Raises `UsageError` if a step is larger than the format allows, or
    the disk refuses.
    """
    with whole_file(path) as temporary:
        savemat(
            temporary,
            _Variables(recording),
            appendmat=False,
            long_field_names=True,
            do_compression=True,
            oned_as="column",
        )


class _Variables(Mapping[str, Any]):
    """The variables of the file; each step is loaded when it is written."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def __getitem__(self, name: str) -> Any:
        if name == "recording":
            return _describe(self._recording)
        return _struct(self._recording.step(int(name.removeprefix("step_"))))

    def __iter__(self) -> Iterator[str]:
        yield "recording"
        yield from (f"step_{info.index:04d}" for info in self._recording.infos)

    def __len__(self) -> int:
        return 1 + len(self._recording.infos)


def _describe(recording: Recording) -> dict[str, Any]:
    meta = recording.meta
    names = dict.fromkeys(name for info in recording.infos for name in recording.channels(info.index))
    return {
        "digest": recording.digest,
        "status": meta.status,
        "unit": _known(asdict(meta.unit)),
        "bench": _known(asdict(meta.bench)),
        "provenance": {_field(name): text for name, text in meta.provenance.items()},
        "simulation": json.dumps(meta.simulation),
        "extra": json.dumps(dict(meta.extra)),
        "units": _known({name: unit_of(name, meta) for name in names}),
    }


def _struct(step: Step) -> dict[str, Any]:
    if sum(samples.nbytes for samples in step.channels.values()) > _LARGEST:
        raise UsageError(
            f"step {step.info.index} {step.info.name!r} is larger than 2 GiB, which a MAT file cannot hold; use netcdf"
        )
    return {**_known({**asdict(step.info), "mounting": step.info.mounting or None}), **step.channels}


def _known(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _field(name: str) -> str:
    """Return a name that MATLAB accepts for a field."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)[:63]


def export_netcdf(recording: Recording, path: Path) -> None:
    """Write a netCDF-4 file with one group per step: `xarray.open_dataset(path, group="steps/0001")`.

    Every benchctl recording already is such a file; this makes one of anything that opens, with a file name that netCDF
    tools recognize.
    """
    write_recording(path, recording.meta, recording.steps())


EXPORTERS: Mapping[str, Callable[[Recording, Path], None]] = {
    "csv": export_csv,
    "mat": export_mat,
    "netcdf": export_netcdf,
    "open": export_open,
}
"""Format -> function that writes it; `csv` and `open` create a folder, `mat` and `netcdf` a file."""
