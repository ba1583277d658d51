"""Compare a recording with simulations of it, and write the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.diagnosis.comparison.pairing import with_predictions, with_recording
from benchctl.diagnosis.comparison.parting import ComparedStep, Parting, part
from benchctl.diagnosis.gyro.frame import frame_of
from benchctl.diagnosis.gyro.limits import not_all_rows
from benchctl.diagnosis.gyro.predicted import predict
from benchctl.limits import require_memory
from benchctl.model_file import read_model
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import Recording, open_recording
from benchctl.reports import diagnosis_words as words
from benchctl.reports import text
from benchctl.reports.comparison_page import comparison_page, sentence
from benchctl.reports.html import write_page
from benchctl.reports.results import make_folder, name_of, source_digest
from benchctl.signals.under_test import under_test
from benchctl_instruments.errors import UsageError

REPORT = "comparison.html"
LAB, NEW = "the lab's model", "the new model"
_MOST_ALONE, _MOST_LINES = 5, 12
_BYTES_A_ROW = 350
"""Measured peak memory per row in a comparison of two recordings."""
_OVERLAID = (
    "Steps are laid over each other by the encoder's rate; what the motions still differ by is taken off by the scale "
    "factor. The noise is that of both recordings."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """The differences between a recording and its simulations, and the recording's metadata for the report."""

    parting: Parting
    recording: str
    meta: Meta
    infos: tuple[StepInfo, ...]
    digest: str
    unit: str
    remarks: tuple[str, ...]


def compare_recordings(simulated: Path, real: Path) -> Compared:
    """Compare two recordings of one procedure; `UsageError` if unreadable, identical or without a common step."""
    with open_recording(simulated) as first, open_recording(real) as second:
        theirs, ours = under_test(first), under_test(second)
        if theirs.digest and theirs.digest == ours.digest:
            raise UsageError(f"{simulated}, {real}: the samples are identical; name two different recordings")
        rows = sum(info.samples for info in (*ours.infos, *theirs.infos))
        require_memory(real, _BYTES_A_ROW * rows, f"laying it and {simulated} over each other")
        steps, alone = with_recording(frame_of(ours), frame_of(theirs), name_of(simulated))
        remarks = [
            *alone[:_MOST_ALONE],
            *([f"and {len(alone) - _MOST_ALONE} more"] if len(alone) > _MOST_ALONE else []),
        ]
        return _compared(ours, name_of(real), steps, (_OVERLAID, *remarks))


def compare_with_models(path: Path, model: Path | None) -> Compared:
    """Compare a recording with the model that it names and, if `model` is given, with another one.

    Raises `UsageError` if the recording or the file cannot be read, or if there is no model at all.
    """
    with open_recording(path) as opened:
        recording = under_test(opened)
        models: dict[str, Mapping[str, Any]] = {}
        if recording.meta.simulation is not None:
            models[LAB] = {"simulation": recording.meta.simulation}
        if model is not None:
            new = read_model(model)
            models[NEW] = {"simulation": new.simulation, "effects": new.effects}
        if not models:
            raise UsageError(
                f"{path}: names no model that it could be compared with; name one with --model FILE, or another "
                "recording of the same procedure"
            )
        predicted = {name: predict(recording, one) for name, one in models.items()}
        frame = next(iter(predicted.values()))[0]
        steps = with_predictions(frame, {name: volts for name, (_, volts) in predicted.items()})
        return _compared(recording, name_of(path), steps, not_all_rows(frame))


def _compared(recording: Recording, name: str, steps: Sequence[ComparedStep], remarks: tuple[str, ...]) -> Compared:
    return Compared(
        parting=part(steps),
        recording=name,
        meta=recording.meta,
        infos=recording.infos,
        digest=source_digest(recording),
        unit=text.unit_text(recording.meta.output_unit),
        remarks=remarks,
    )


def values(compared: Compared) -> dict[str, Any]:
    """Return a comparison as plain data for `--json`."""
    parting = compared.parting
    return {
        "recording": compared.recording,
        "against": list(parting.simulations),
        "rms_v": dict(parting.rms_v),
        "noise_v": parting.noise_v,
        "steps": [
            {
                "name": step.name,
                "kind": step.kind,
                "t_start": step.t_start,
                "t_end": step.t_end,
                "rms_v": dict(step.rms_v),
                "mean_v": dict(step.mean_v),
                "noise_v": step.noise_v,
            }
            for step in parting.steps
        ],
        "coordinates": {
            of.coordinate: {
                "edges": of.edges.tolist(),
                "mean_v": {name: mean.tolist() for name, mean in of.mean_v.items()},
                "standard_error_v": of.standard_error_v.tolist(),
            }
            for of in parting.coordinates
        },
        "remarks": list(compared.remarks),
    }


def table(compared: Compared) -> str:
    """Return the comparison as a short table: overall, and the steps with the largest differences."""
    parting, unit = compared.parting, compared.unit
    furthest = sorted(parting.steps, key=lambda step: -step.rms_v[parting.simulations[0]])[:_MOST_LINES]
    lines = [*compared.remarks, sentence(parting, unit)]
    header = "".join(f"{name:>24}" for name in parting.simulations)
    lines.append(f"{'step, rms of measured less simulated':<40}{header}{'noise':>12}")
    for step in furthest:
        cells = "".join(f"{words.size(step.rms_v[name], unit):>24}" for name in parting.simulations)
        lines.append(f"{step.name:<40}{cells}{words.size(step.noise_v, unit):>12}")
    if len(parting.steps) > len(furthest):
        lines.append(f"and {len(parting.steps) - len(furthest)} steps that part less")
    return "\n".join(lines)


def write_compared(compared: Compared, folder: Path) -> Path:
    """Write the report into a folder and its manifest; raises `UsageError` if the folder is not writable."""
    make_folder(folder)
    path = folder / REPORT
    page = comparison_page(
        compared.parting,
        compared.recording,
        compared.meta,
        compared.infos,
        digest=compared.digest,
        unit=compared.unit,
        remarks=compared.remarks,
    )
    write_page(path, page)
    add_to_manifest(folder, [path])
    return path
