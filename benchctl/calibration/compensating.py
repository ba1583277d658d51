"""A `coefficients.json` ready for use: its law, its valid range, its unit; applied to files and exported.

`benchctl apply` copies a recording and adds the compensated rate. `benchctl export --to json` writes the compensation
for programs that read JSON, without the details of the fit:

| key | content |
|---|---|
| `schema` | `benchctl-compensation/1` |
| `law`, `formula` | `sine`, `polynomial` or `response`, and the formula of the rate, in words |
| `K0_v_per_dps`, `U0_v`, `T0_c` | scale factor, output at rest, reference of ΔT (null: temperature has no influence) |
| `U0_T` | coefficients of ΔT, ΔT², … of the bias, V/°C^i |
| `S_rad_per_dps` | of the sine, else null |
| `stages` | list: `k_T` (of ΔT, ΔT², …) and `k_omega` (of ω², ω⁴, …), as the formula uses them |
| `discovered` | what is subtracted from U first, if a diagnosis found it: see below |
| `delay_s` | a rate applies to its output's time minus this |
| `earth_rate_dps` | the Earth's part of the sensed rate, if the calibration's latitude was known |
| `valid` | ranges `rate_dps` and `temperature_c` that were measured; null: not recorded |
| `uncertainty` | `k`; `expanded` by parameter: `c1` of `U0_T[0]`, `g1` or `a1` of `k_T[0]`, `b2` of `k_omega[0]` |
| `error_percent` | largest residual over largest rate, on runs that were not fitted, or null |
| `unit`, `output_unit` | serial; the output's unit if it is a rate and not V, as the names suggest |
| `source`, `coefficients_sha256` | digests of the recordings that were fitted, and of the file |
| `self_test` | `columns`, `points` and `tolerance_dps`: a program with a larger error at a point is wrong |

`discovered` is present if structures without a name are compensated, too: `U0_v`, and a list `structures` with `name`,
`acts_on` (`scale` or `bias`), `over` and `times` (coordinates), `formula` and `parameters`. The law's `formula` is then
applied to the corrected output, U0_v + (U − Σ f_bias − U0_v)/Π(1 + f_scale); each f is evaluated at the resulting rate.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchctl.atomic import whole_file
from benchctl.calibration.coefficients import By, Coefficients, applied_law, checked, coefficients_in, is_of_law
from benchctl.calibration.discovered import Discovered
from benchctl.calibration.model import AppliedLaw
from benchctl.calibration.result import ValidRange
from benchctl.documents import json_document
from benchctl.limits import MOST_DESCRIPTION_BYTES, read_whole, shown
from benchctl.recordings.model import (
    COMPENSATED,
    COMPENSATED_VALID,
    FRAME_CHANNELS,
    FRAME_COMPENSATED,
    FRAME_COMPENSATED_VALID,
    Meta,
    Step,
    axis_of,
)
from benchctl.recordings.reader import Recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.structure_shapes import SHAPES


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensation:
    """The compensation for the output of one unit.

    Attributes
    ----------
    law, by
        The law, and whether it is that of the joint fit or of the stages.
    valid
        The measured range; a temperature that is not recorded has no bounds, −inf to inf.
    unit, output_unit
        The unit's serial, empty if the file names none, and the unit of its output.
    sha256
        Digest of the file's bytes.
    sources
        Name and digest of every recording that was fitted.
    k, expanded
        Coverage factor and expanded uncertainty of the law's parameters, by their names in the file.
    error_percent
        Largest residual over the largest rate of a run, on runs that were not fitted; None if there were none.
    earth_rate_dps
        The vertical part of the Earth's rate that the sensed rate contains in addition to the table's.
    """

    law: AppliedLaw
    by: By
    valid: ValidRange
    unit: str
    output_unit: str
    sha256: str
    sources: tuple[tuple[str, str], ...]
    k: float
    expanded: Mapping[str, float]
    error_percent: float | None
    earth_rate_dps: float

    def inside(self, rate_dps: FloatArray, celsius: FloatArray) -> BoolArray:
        """Return whether rate and temperature, arrays of one shape, are within the measured range."""
        (slowest, fastest), (coldest, warmest) = self.valid.rate_dps, self.valid.temperature_c
        within = (rate_dps >= slowest) & (rate_dps <= fastest) & (celsius >= coldest) & (celsius <= warmest)
        return np.asarray(within)


def read_compensation(path: Path, by: By | None = None) -> Compensation:
    """Read coefficients for use: by the joint fit or the stages; None: by the joint fit if there is one.

    Raises
    ------
    UsageError
        If the file cannot be read or used, has no such law, or does not state its valid range.
    """
    text = read_whole(path, MOST_DESCRIPTION_BYTES, "coefficients ")
    found = checked(coefficients_in(json_document(text, f"coefficients {path}"), path), str(path))
    if by is None:
        by = "stages" if found.joint is None else "joint"
    try:
        return _compensation(found, by, hashlib.sha256(text).hexdigest())
    except UsageError as err:
        raise UsageError(f"{path}: {err}") from err


def _compensation(found: Coefficients, by: By, sha256: str) -> Compensation:
    law = applied_law(found, by)
    levels = ("joint",) if by == "joint" else ("stage_2", "stage_1")
    of_another = by == "stages" and found.joint is not None  # the file's uncertainties are those of the joint fit
    return Compensation(
        law=law,
        by=by,
        valid=_valid(found),
        unit=found.unit or "",
        output_unit=found.output_unit,
        sha256=sha256,
        sources=tuple((source.recording, source.digest) for source in found.source),
        k=found.uncertainty.k,
        expanded={
            name: parameter.expanded
            for name, parameter in found.uncertainty.parameters.items()
            if parameter.expanded is not None and is_of_law(name, law) and not of_another
        },
        error_percent=next((found.error_percent[name] for name in levels if name in found.error_percent), None),
        earth_rate_dps=found.earth_rate_dps,
    )


def _valid(found: Coefficients) -> ValidRange:
    if found.valid is None:
        raise UsageError("does not say where it is valid (`valid`); write it with `benchctl fit`")
    slowest, fastest = found.valid.rate_dps
    low, high = found.valid.temperature_c
    coldest, warmest = -math.inf if low is None else low, math.inf if high is None else high
    if not (slowest < fastest and coldest <= warmest):
        raise UsageError(
            f"`valid` is {shown([slowest, fastest])} deg/s and {shown([low, high])} °C, expected the lower end "
            "first; write it with `benchctl fit`"
        )
    return ValidRange(rate_dps=(slowest, fastest), temperature_c=(coldest, warmest))


TOLERANCE = 1e-9
"""Tolerance of another program, relative to the largest rate in `valid`: far above rounding, far below any gyro."""

_RATES, _TEMPERATURES = 7, 5
_RATES_ALONE = 25
_FINE = 15
_REACHED = 1e-6
_ROOM_C = 20.0


@dataclass(frozen=True, slots=True)
class SelfTestPoint:
    """An output [V] at a temperature [°C], and its rate [°/s], to check another program's compensation."""

    volts: float
    celsius: float
    rate_dps: float


def tolerance_dps(compensation: Compensation) -> float:
    """Return the tolerance of a self-test point, °/s."""
    return TOLERANCE * max(map(abs, compensation.valid.rate_dps))


def self_test_points(compensation: Compensation) -> list[SelfTestPoint]:
    """Return a grid over the valid range, corners included: 35 points, 25 at one temperature, 225 with structures.

    Raises `UsageError` if the law has no output for a rate in the range: then it was not measured there.
    """
    law, valid = compensation.law, compensation.valid
    coldest, warmest = valid.temperature_c
    if not (math.isfinite(coldest) and math.isfinite(warmest)):
        coldest = warmest = law.T0_c or _ROOM_C
    several = warmest > coldest
    fine = bool(law.discovered)  # local structures must be visible
    temperatures = np.linspace(coldest, warmest, (_FINE if fine else _TEMPERATURES) if several else 1)
    rates = np.linspace(*valid.rate_dps, _FINE if fine else _RATES if several else _RATES_ALONE)
    rate_dps, celsius = (grid.ravel() for grid in np.meshgrid(rates, temperatures))
    volts = law.volts(rate_dps, celsius)
    given = law.rate_dps(volts, celsius)
    missed = np.flatnonzero(~(np.abs(given - rate_dps) <= _REACHED * np.abs(valid.rate_dps).max()))
    if missed.size:
        first = missed[0]
        raise UsageError(
            f"the law has no output for {rate_dps[first]:.6g} deg/s at {celsius[first]:.6g} °C, which lies in `valid`; "
            "write the coefficients with `benchctl fit`"
        )
    return [SelfTestPoint(*map(float, point)) for point in zip(volts, celsius, given, strict=True)]


@dataclass(frozen=True, slots=True)
class _Channels:
    """The channels of an output, its temperature and its status (0: valid; "": none), and those of the result."""

    output: str
    celsius: str
    status: str
    rate: str
    valid: str


_OF_SCANS = _Channels("gyro_v", "gyro_temp_c", "", COMPENSATED, COMPENSATED_VALID)
_OF_FRAMES = _Channels(*FRAME_CHANNELS[1:], FRAME_COMPENSATED, FRAME_COMPENSATED_VALID)


@dataclass(slots=True)
class Applied:
    """The result of the compensation of a recording.

    `samples` have a rate or NaN, of which `outside` have a rate or a temperature outside the measured range, by at most
    `most_dps` and `most_c`; `without` lists the steps that have an output but no temperature.
    """

    samples: int = 0
    outside: int = 0
    most_dps: float = 0.0
    most_c: float = 0.0
    without: tuple[int, ...] = ()


def write_compensated(
    path: Path, recording: Recording, compensation: Compensation, *, digest: str, coefficients: str
) -> Applied:
    """Write a copy of the recording with `compensated_dps` and `compensated_valid` in each step that can have them.

    Coefficients of a rate are applied to a digital gyro's frames, if there are any: `frame_compensated_dps`,
    `frame_compensated_valid`. Samples that the gyro states as invalid have no rate.

    One step is in memory at a time. The provenance names the recording by its `digest`, and the file of coefficients
    by its name and SHA-256. No sample is moved in time: `comment` of the channel states its delay.

    Raises
    ------
    UsageError
        If the coefficients are of another unit or output, the recording is already compensated, no step has an output
        and a temperature, or the disk cannot be written. No partial file remains.
    """
    channels = {info.index: recording.channels(info.index) for info in recording.infos}
    digital = compensation.output_unit == "deg/s" and any(_OF_FRAMES.output in names for names in channels.values())
    _refuse_another(recording, compensation, "deg/s" if digital else recording.meta.output_unit)
    own = _OF_FRAMES if digital else _OF_SCANS
    if any(own.rate in names for names in channels.values()):
        raise UsageError(
            f"{recording.path}: has {own.rate} already; take the recording that it was made of, which its "
            "provenance names"
        )
    if not any({own.output, own.celsius} <= set(names) for names in channels.values()):
        raise UsageError(
            f"{recording.path}: no step has {own.output} and {own.celsius}, sample by sample, and so nothing "
            "to compensate; `benchctl show` lists its channels"
        )
    applied = Applied(
        without=tuple(index for index, names in channels.items() if own.output in names and own.celsius not in names)
    )
    meta = _described(recording, compensation, own, digest, coefficients)
    write_recording(path, meta, _compensated(recording, compensation, own, applied))
    return applied


def _refuse_another(recording: Recording, compensation: Compensation, output_unit: str) -> None:
    serial = recording.meta.unit.serial
    if serial and compensation.unit and serial != compensation.unit:
        raise UsageError(
            f"{recording.path}: is of unit {serial}, the coefficients are of unit {compensation.unit}; take those of "
            "its own unit"
        )
    if output_unit != compensation.output_unit:
        raise UsageError(
            f"{recording.path}: its output is in {output_unit}, that of the coefficients in "
            f"{compensation.output_unit}; take those that were fitted on such a recording"
        )


def _described(
    recording: Recording, compensation: Compensation, own: _Channels, digest: str, coefficients: str
) -> Meta:
    meta, law, valid = recording.meta, compensation.law, compensation.valid
    facts = {
        "recording": recording.path.name,
        "digest": digest,
        "coefficients": coefficients,
        "coefficients_sha256": compensation.sha256,
        "law": compensation.by,
        "delay_s": law.delay_s,
    }
    comments = {
        own.rate: f"by coefficients with SHA-256 {compensation.sha256}, law {law.name} of the "
        f"{'joint fit' if compensation.by == 'joint' else 'stages'}; the rate belongs to {axis_of(own.rate)} - "
        f"{law.delay_s:.9g} s",
        own.valid: f"the coefficients were measured from {valid.rate_dps[0]:.9g} to {valid.rate_dps[1]:.9g} "
        f"degree/s and from {valid.temperature_c[0]:.9g} to {valid.temperature_c[1]:.9g} degC",
    }
    return replace(
        meta,
        provenance={**meta.provenance, "compensation": json.dumps(facts, ensure_ascii=False)},
        extra={**meta.extra, "channel_comments": {**meta.extra.get("channel_comments", {}), **comments}},
    )


def _compensated(recording: Recording, compensation: Compensation, own: _Channels, applied: Applied) -> Iterator[Step]:
    for step in recording.steps():
        has_both = {own.output, own.celsius} <= set(step.channels)
        yield _with_rate(step, compensation, own, applied) if has_both else step


def _with_rate(step: Step, compensation: Compensation, own: _Channels, applied: Applied) -> Step:
    celsius = step[own.celsius]
    rate_dps = compensation.law.rate_dps(step[own.output], celsius)
    if own.status:
        rate_dps = np.where(step[own.status] == 0.0, rate_dps, np.nan)
    inside = compensation.inside(rate_dps, celsius)
    applied.samples += inside.size
    applied.outside += int(np.count_nonzero(~inside))
    applied.most_dps = max(applied.most_dps, _beyond(rate_dps, compensation.valid.rate_dps))
    applied.most_c = max(applied.most_c, _beyond(celsius, compensation.valid.temperature_c))
    return Step(step.info, {**step.channels, own.rate: rate_dps, own.valid: inside.astype(np.float64)})


def _beyond(values: np.ndarray, ends: tuple[float, float]) -> float:
    known = values[np.isfinite(values)]
    return float(max(np.max(known, initial=ends[1]) - ends[1], ends[0] - np.min(known, initial=ends[0]), 0.0))


SCHEMA = "benchctl-compensation/1"

_INDICATED = "x = (U - U0_v - sum of U0_T[i] * dT**(i + 1)) / K0_v_per_dps with dT = T - T0_c"
_FACTORS = "k_T = 1 + sum of stage.k_T[i] * dT**(i + 1)"
_BENT = "k_omega(w) = 1 + sum of stage.k_omega[i] * w**(2 * i + 2)"
FORMULAS = {
    "sine": f"{_INDICATED}; {_FACTORS}; rate = asin(S_rad_per_dps * x / k_T) / S_rad_per_dps",
    "polynomial": f"{_INDICATED}; rate = x; for each stage in turn: {_FACTORS}, {_BENT}, rate = rate * k_T * "
    "k_omega(rate)",
    "response": f"{_INDICATED}; {_FACTORS}; {_BENT}; rate is the solution nearest to 0 of rate * k_omega(rate) = "
    "x / k_T",
}
"""Law -> the formula of the rate for an output U at a temperature T [degC]."""


def compensation_json(compensation: Compensation) -> dict[str, Any]:
    """Return the content; raise `UsageError` if the law has no output for a rate in `valid`."""
    law = compensation.law
    points = self_test_points(compensation)
    return {
        "schema": SCHEMA,
        "unit": compensation.unit,
        "output_unit": compensation.output_unit,
        "law": law.name,
        "formula": FORMULAS[law.name],
        "rate_is": "sensed, in deg/s: that of the case and the part of the Earth's along the axis",
        "K0_v_per_dps": law.K0_v_per_dps,
        "U0_v": law.U0_v,
        "T0_c": law.T0_c if law.knows_temperature else None,
        "U0_T": list(law.bias),
        "S_rad_per_dps": law.S_rad_per_dps if law.name == "sine" else None,
        "stages": [{"k_T": list(stage.k_t), "k_omega": list(stage.k_omega)} for stage in law.stages],
        **({"discovered": _written(law.discovered)} if law.discovered else {}),
        "delay_s": law.delay_s,
        "earth_rate_dps": compensation.earth_rate_dps,
        "valid": {
            "rate_dps": list(compensation.valid.rate_dps),
            "temperature_c": [end if math.isfinite(end) else None for end in compensation.valid.temperature_c],
        },
        "uncertainty": {"k": compensation.k, "expanded": dict(compensation.expanded)},
        "error_percent": compensation.error_percent,
        "source": [{"recording": name, "digest": digest} for name, digest in compensation.sources],
        "coefficients_sha256": compensation.sha256,
        "self_test": {
            "columns": ["volts", "celsius", "rate_dps"],
            "points": [[point.volts, point.celsius, point.rate_dps] for point in points],
            "tolerance_dps": tolerance_dps(compensation),
        },
    }


def _written(discovered: Discovered) -> dict[str, Any]:
    structures = [
        {
            "name": name,
            "acts_on": one.acts_on,
            "over": one.over,
            "times": one.times,
            "formula": SHAPES[one.shape].written(one.over, one.times),
            "parameters": one.values,
        }
        for name, one in discovered.structures.items()
    ]
    return {"U0_v": discovered.U0_v, "structures": structures}


def export_json(compensation: Compensation, path: Path) -> None:
    """Write the file atomically; raise `UsageError` if the law is not suitable or the disk cannot be written."""
    text = json.dumps(compensation_json(compensation), indent=1, ensure_ascii=False, allow_nan=False)
    with whole_file(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")
