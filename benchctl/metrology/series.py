"""Read an evenly sampled series, and its unit, from a step of a recording or a column of a text file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchctl.closeness import meant
from benchctl.limits import shown
from benchctl.recordings.model import FRAME_CHANNELS, UNITS, StepInfo, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import TOLERANCE, gap_free
from benchctl.recordings.stored import StoredStep
from benchctl.recordings.text_file import Layout, header_names, read_bytes, read_columns
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

DEG_PER_S = "deg/s"
_GYRO_OUTPUT, _DIGITAL_RATE = "gyro_v", FRAME_CHANNELS[1]
_UNITS = {"degree/s": DEG_PER_S, "degree s-1": DEG_PER_S, "degC": "degC", "V": "V", "degree": "deg"}
_NAMED = {"dps": DEG_PER_S, "deg/s": DEG_PER_S, "v": "V", "c": "degC", "degc": "degC", "deg": "deg"}
_NAME_UNIT = re.compile(r"(?:_(?P<suffix>[A-Za-z]+)|[\[(](?P<bracket>[^\])]+)[\])])$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Samples `values` (n,) in `unit`, one every `interval_s`; `source` describes them."""

    values: FloatArray
    interval_s: float
    unit: str
    source: str


def series_of_step(
    recording: Recording, channel: str | None, step: str | None, scale_v_per_dps: float | None = None
) -> Series:
    """Return a channel of a step; by default the digital gyro's rate or the gyro's output, in the longest static step.

    The gyro's volts are converted to a rate by `scale_v_per_dps`, or by the scale factor of the lab's model in the
    recording, if there is one.

    Raises
    ------
    UsageError
        If there is no such step or channel, no static step, or fewer than three samples between two gaps.
    """
    info = _step(recording, step)
    names = recording.channels(info.index)
    name = channel or (_DIGITAL_RATE if _DIGITAL_RATE in names else _GYRO_OUTPUT)
    axis = axis_of(name)
    if name not in names or axis not in names or name == axis:
        there = [one for one in names if one != axis_of(one)]
        hint = meant(name, there, f"it has {', '.join(there)}")
        raise UsageError(f"{recording.path}, step {shown(info.name)}: has no channel {shown(name)}; {hint}")
    stated = recording.meta.output_unit if name == _GYRO_OUTPUT else UNITS.get(name, "1")
    unit = _UNITS.get(stated, stated)
    if unit == "V" and name == _GYRO_OUTPUT:
        scale_v_per_dps = scale_v_per_dps or (recording.meta.simulation or {}).get("K0_v_per_dps")
    elif scale_v_per_dps is not None:
        raise UsageError(
            f"{recording.path}: {shown(name)} is in {unit}, a scale factor is for {_GYRO_OUTPUT} in V; leave it out"
        )
    values, interval_s, part = _even_samples(recording, info, name, abs(scale_v_per_dps or 1.0))
    words = f"{name} of step {info.name!r}{part}"
    if scale_v_per_dps:
        words += f", as a rate by {abs(scale_v_per_dps):.6g} V/(deg/s)"
        unit = DEG_PER_S
    return Series(values=values, interval_s=interval_s, unit=unit, source=words)


def series_of_text(path: Path, channel: str | None, rate_hz: float | None) -> Series:
    """Return a column of a comma-separated text file; without `channel` the only one apart from the time.

    The interval is that of `rate_hz`, or of a column in seconds whose name begins with `time`. The unit is read from
    the end of the column's name: `rate_dps`, `output_v`, `rate [deg/s]`.

    Raises
    ------
    UsageError
        If the file, the column or the sampling rate is missing, or a cell is not a number.
    """
    text = read_bytes(path)
    first = text.split(b"\n", 1)[0]
    bare = re.fullmatch(rb"[\s,;0-9eE+.-]*", first) is not None
    layout = Layout(header_line=0, first_line=1) if bare else Layout()
    names = header_names(path, text, layout) or tuple(f"column {k + 1}" for k in range(first.count(b",") + 1))
    clock = next((name for name in names if name.lower().startswith("time")), None)
    others = [name for name in names if name and name != clock]
    if channel is None and len(others) != 1:
        raise UsageError(f"{path}: has the columns {', '.join(map(shown, others))}; name one with --channel")
    name = channel or others[0]
    if name not in names:
        hint = meant(name, others, f"it has {', '.join(map(shown, others))}")
        raise UsageError(f"{path}: has no column {shown(name)}; {hint}")
    if rate_hz is None and clock is None:
        raise UsageError(f"{path}: has no column of time; say how often it was sampled with --rate-hz")
    wanted = {name: names.index(name)} | ({clock: names.index(clock)} if clock and rate_hz is None else {})
    columns = read_columns(path, text, layout, wanted)
    if rate_hz is not None:
        values, interval_s, part = columns[name], 1.0 / rate_hz, ""
    else:
        values, interval_s, part = _unbroken(columns[str(clock)], columns[name], str(path))
    source = f"column {name!r} of {path.name}{part}"
    return Series(values=values, interval_s=interval_s, unit=_named_unit(name), source=source)


def _step(recording: Recording, name: str | None) -> StepInfo:
    if name is not None:
        for info in recording.infos:
            if name in (info.name, str(info.index)):
                return info
        steps = [info.name for info in recording.infos]
        raise UsageError(
            f"{recording.path}: has no step {shown(name)}; {meant(name, steps, '`benchctl show` lists them')}"
        )
    static = [info for info in recording.infos if info.kind == "static" and info.whole and not info.mounting]
    if not static:
        raise UsageError(f"{recording.path}: has no complete static step; name a step with --step")
    return max(static, key=lambda info: info.t_end - info.t_start)


def _even_samples(recording: Recording, info: StepInfo, name: str, over: float) -> tuple[FloatArray, float, str]:
    """As `_unbroken`, divided by a scale; scans without gaps are read in parts, so that only their samples are held."""
    axis, where = axis_of(name), f"{recording.path}, step {shown(info.name)}"
    step = recording.stored_step(info.index)
    interval_s = _interval_without_gaps(step) if axis == "time_s" else None
    if interval_s is None:
        held = recording.step(info.index, (name, axis))
        values, interval_s, words = _unbroken(held[axis], held[name], where)
        return values / over, interval_s, words
    values = np.empty(step.scans)
    done = 0
    for part in step.parts((name,)):
        np.divide(part[name], over, out=values[done : done + part[name].size])
        done += part[name].size
    return values, interval_s, ""


def _interval_without_gaps(step: StoredStep) -> float | None:
    """Return the sampling interval of scans that certainly have no gap; None if they may have one."""
    if step.scans < 3:
        return None
    first_s = last_s = float(step.read("time_s", 0, 1)[0])
    spread_s: list[float] = []
    begins = True
    for part in step.parts(("time_s",)):
        steps_s = np.diff(part["time_s"], prepend=[] if begins else last_s)
        spread_s += [float(steps_s.min()), float(steps_s.max())]
        last_s, begins = float(part["time_s"][-1]), False
    least_s, most_s = np.min(spread_s), np.max(spread_s)  # NaN if a stamp is NaN
    return (last_s - first_s) / (step.scans - 1) if _even(least_s, most_s) else None


def _unbroken(time_s: FloatArray, values: FloatArray, where: str) -> tuple[FloatArray, float, str]:
    """Return the longest stretch without a gap, its sampling interval, and a note if samples are left out."""
    steps_s = np.diff(time_s)
    if steps_s.size < 2 or not steps_s.min() > 0.0:
        raise UsageError(f"{where}: expected at least 3 samples, at times that grow; correct its stamps")
    if _even(steps_s.min(), steps_s.max()):  # without the median, which is slow to compute
        runs = [slice(0, time_s.size)]
    else:
        runs = gap_free(time_s, float(np.median(steps_s)))
    part = max(runs, key=lambda run: run.stop - run.start)
    if part.stop - part.start < 3:
        raise UsageError(f"{where}: {len(runs) - 1} gaps leave no 3 samples in a row; record it without gaps")
    even_s = float(time_s[part.stop - 1] - time_s[part.start]) / (part.stop - part.start - 1)
    return values[part], even_s, f", the longest stretch between {len(runs) - 1} gaps" if len(runs) > 1 else ""


def _even(least_s: float, most_s: float) -> bool:
    """Return whether time steps between `least_s` and `most_s` certainly contain no gap."""
    return 0.0 < least_s <= most_s <= (1.0 + TOLERANCE) * least_s


def _named_unit(name: str) -> str:
    match = _NAME_UNIT.search(name.strip())
    unit = (match.group("suffix") or match.group("bracket")).strip().lower() if match else ""
    return _NAMED.get(unit, "1")
