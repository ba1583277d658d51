"""Diagnose recordings, and write the report and the model file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchctl import diagnosis
from benchctl.atomic import whole_file
from benchctl.diagnosis.parts import part_of
from benchctl.diagnosis.result import COORDINATE_UNITS, Diagnosis, Finding, Part, Slice, Verdict
from benchctl.model_file import Model, read_model, write_model
from benchctl.part_models import EFFECTS
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import join, open_recording
from benchctl.recordings.verify import refuse_changed
from benchctl.reports import diagnosis_words as words
from benchctl.reports.diagnosis_words import estimate
from benchctl.reports.results import make_folder, name_of, source_digest
from benchctl.signals.under_test import under_test
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

REPORT, SUMMARY, MODEL = "diagnosis.html", "diagnosis.json", "model.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosed:
    """A diagnosis; `print` shows its text.

    `diagnosis` is the complete result; its `as_json()` is the output of `benchctl diagnose --json`. The metadata of the
    recordings are for its report; `unit` is that of the diagnosed quantity. `files` are the paths of `report`,
    `summary` and `model`, if they were written.
    """

    diagnosis: Diagnosis = field(repr=False)
    meta: Meta = field(repr=False)
    infos: tuple[StepInfo, ...] = field(repr=False)
    digest: str
    unit: str
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """`consistent`, `recalibrate`, `missing-physics` or `unknown-structure`."""
        return self.diagnosis.verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The effects found, each with its parameters, their 95 % intervals, its coordinate and the alternatives."""
        return self.diagnosis.findings

    def __str__(self) -> str:
        return "\n".join([self.diagnosis.says, *(finding.says for finding in self.findings)])

    def write(self, folder: Path) -> Diagnosed:
        """Write report, summary and model file into a folder and its manifest, each atomically.

        Returns the diagnosis with their paths. Raises `UsageError` if the folder is not writable.
        """
        from benchctl.reports.diagnosis_page import diagnosis_page  # matplotlib is slow to load
        from benchctl.reports.html import write_page

        make_folder(folder)
        files = {"report": folder / REPORT, "summary": folder / SUMMARY}
        page = diagnosis_page(self.diagnosis, self.meta, self.infos, digest=self.digest, unit=self.unit)
        write_page(files["report"], page)
        write_diagnosis_file(files["summary"], self.diagnosis, self.digest)
        if self.diagnosis.model:
            files["model"] = folder / MODEL
            write_model(files["model"], _as_model(self.diagnosis.model))
        add_to_manifest(folder, files.values())
        return replace(self, files=files)


def diagnose(
    paths: Sequence[Path],
    *,
    model: Path | None = None,
    part: Part | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosed:
    """Diagnose one recording, or several of one unit jointly, with the model of the first one or of a file.

    Without `part`, it is the one that the recordings are of: the drive or the chamber if they have no gyro.

    `progress` is called with the current trial and the completed fraction of the work, 0 to 1. Raises `UsageError` if a
    recording was changed or cannot be read or diagnosed, or if the recordings are of different units.
    """
    for path in paths:
        refuse_changed(path, "diagnosed")
    with ExitStack() as stack:
        recordings = [stack.enter_context(open_recording(path)) for path in paths]
        joined = join(recordings)
        part = part or part_of(joined)
        joined = under_test(joined) if part == "gyro" else joined
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


def _believed(path: Path, part: Part) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """Return the lab's model of the part from a file, and notes on effects that are not assumed."""
    model = read_model(path)
    simulation, table, effects = model.simulation, "[simulation]", model.effects
    if part != "gyro":
        simulation, table = model.parts.get(part), f"[parts.{part}]"
        effects = simulation.get(EFFECTS, {}) if simulation else {}
    if simulation is None:
        raise UsageError(f"model {path}: has no {table}: it does not describe the {part}; add the table")
    others = ", ".join(effects)
    notes = (f"The effects of {path.name} ({others}) are not taken for granted: they were looked for.",)
    return simulation, notes if others else ()


def _as_model(data: Mapping[str, Any]) -> Model:
    return Model(**{name: part for name, part in data.items() if name != "format"})


_DIGITS = 6


def write_diagnosis_file(path: Path, diagnosis: Diagnosis, digest: str) -> None:
    """Write the file atomically; `digest` is that of the recording, or those of several, separated by commas.

    `map` has for each coordinate the edges of its bins, the mean residual in them before and after the findings and its
    standard error (None in an empty bin); `threshold` is the number of standard errors that chance alone exceeds with a
    probability of 1 %. `stated` is a parameter as printed in the report. Raises `UsageError` if the file cannot be
    written.
    """
    content = {
        **diagnosis.as_json(),
        "recording_digest": digest,
        "map": [_slice(one, diagnosis.fit.unit) for one in diagnosis.slices],
    }
    for entry, finding in zip(content["findings"], diagnosis.findings, strict=True):
        for name, value in finding.parameters.items():
            entry["parameters"][name]["stated"] = estimate(value)
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
