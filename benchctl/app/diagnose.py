"""From recordings to a diagnosis, its report and its model file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchctl import diagnosis
from benchctl.atomic import whole_file
from benchctl.diagnosis.result import COORDINATE_UNITS, Diagnosis, Part, Slice
from benchctl.model_file import Model, read_model, write_model
from benchctl.part_models import EFFECTS
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import join, open_recording
from benchctl.reports import diagnosis_words as words
from benchctl.reports.diagnosis_words import estimate
from benchctl.reports.results import make_folder, name_of, source_digest
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

REPORT, SUMMARY, MODEL = "diagnosis.html", "diagnosis.json", "model.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosed:
    """A diagnosis with what its report says of the recordings; `unit` is that of the diagnosed quantity."""

    diagnosis: Diagnosis
    meta: Meta
    infos: tuple[StepInfo, ...]
    digest: str
    unit: str


def diagnose_recordings(
    paths: Sequence[Path],
    *,
    model: Path | None = None,
    part: Part = "gyro",
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosed:
    """Diagnose one recording, or several of one unit jointly, by the model that the first names or that of a file.

    Raises `UsageError` where a recording cannot be read or diagnosed, or they are of different units.
    """
    with ExitStack() as stack:
        recordings = [stack.enter_context(open_recording(path)) for path in paths]
        joined = join(recordings)
        believed, notes = (None, ()) if model is None else _believed(model, part)
        found = diagnosis.diagnose(joined, model=believed, part=part, seed=seed, progress=progress)
        names = " + ".join(name_of(path) for path in paths)
        return Diagnosed(
            diagnosis=replace(found, recording=names, notes=(*found.notes, *notes)),
            meta=joined.meta,
            infos=joined.infos,
            digest=", ".join(source_digest(recording) for recording in recordings),
            unit=words.unit(found.fit.unit),
        )


def write_diagnosed(diagnosed: Diagnosed, folder: Path) -> dict[str, Path]:
    """Write report, summary and model file, each whole or not at all; where they are, by what they are.

    Raises `UsageError` where the folder may not be written to.
    """
    from benchctl.reports.diagnosis_page import write_diagnosis_report  # matplotlib is slow to load

    make_folder(folder)
    written = {"report": folder / REPORT}
    write_diagnosis_report(
        written["report"],
        diagnosed.diagnosis,
        diagnosed.meta,
        diagnosed.infos,
        digest=diagnosed.digest,
        unit=diagnosed.unit,
    )
    written["summary"] = folder / SUMMARY
    write_diagnosis_file(written["summary"], diagnosed.diagnosis, diagnosed.digest)
    if diagnosed.diagnosis.model:
        written["model"] = folder / MODEL
        write_model(written["model"], _as_model(diagnosed.diagnosis.model))
    return written


def _believed(path: Path, part: Part) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """The lab's model of the part in a file, and what of the file a diagnosis does not begin with, in words."""
    model = read_model(path)
    told, table, effects = model.simulation, "[simulation]", model.effects
    if part != "gyro":
        told, table = model.parts.get(part), f"[parts.{part}]"
        effects = told.get(EFFECTS, {}) if told else {}
    if told is None:
        raise UsageError(
            f"model {path}: has no {table}: it says nothing of what the {part} should have done; add the table"
        )
    others = ", ".join(effects)
    notes = (f"The effects of {path.name} ({others}) are not taken for granted: they were looked for.",)
    return told, notes if others else ()


def _as_model(told: Mapping[str, Any]) -> Model:
    return Model(**{name: part for name, part in told.items() if name != "format"})


_DIGITS = 6


def write_diagnosis_file(path: Path, diagnosis: Diagnosis, digest: str) -> None:
    """Write the file, whole or not at all; `digest` is that of the recording, or those of several, with commas.

    `map` has for each coordinate the edges of its bins, the mean residual in them before and after the findings, its
    standard error (None where a bin is empty), and how many of those chance alone reaches one time in a hundred.
    `stated` is a parameter as the report prints it. Raises `UsageError` where the disk refuses.
    """
    content = {
        **diagnosis.as_json(),
        "recording_digest": digest,
        "map": [_slice(one, diagnosis.fit.unit) for one in diagnosis.slices],
    }
    for told, finding in zip(content["findings"], diagnosis.findings, strict=True):
        for name, value in finding.parameters.items():
            told["parameters"][name]["stated"] = estimate(value)
    with whole_file(path) as temporary:
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        temporary.write_text(f"{text}\n", encoding="utf-8")


def _slice(one: Slice, measured: str) -> dict[str, Any]:
    return {
        "coordinate": one.coordinate,
        "unit": measured if one.coordinate == "output" else COORDINATE_UNITS.get(one.coordinate, ""),
        "threshold": _rounded(np.array([one.threshold]))[0],
        **{name: _rounded(getattr(one, name)) for name in ("edges", "before", "after", "standard_error")},
    }


def _rounded(values: FloatArray) -> list[float | None]:
    return [float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None for value in values]
