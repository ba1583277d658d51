"""Where recordings and their simulations part: the numbers, and the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchctl.diagnosis.comparison.pairing import with_predictions, with_recording
from benchctl.diagnosis.comparison.parting import Parting, StepParting, part
from benchctl.diagnosis.gyro.frame import frame_of
from benchctl.diagnosis.gyro.limits import not_all_rows
from benchctl.diagnosis.gyro.predicted import predict
from benchctl.limits import require_memory
from benchctl.model_file import read_model
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import open_recording
from benchctl.reports import diagnosis_words as words
from benchctl.reports import setup_section, text
from benchctl.reports.figures import LEVEL_COLOURS, LEVEL_MARKERS, Drawing, inline_svg, new_figure, style
from benchctl.reports.html import render, write_page
from benchctl.reports.mismatch_figures import Look, StepMark, along, excerpt, name_excerpts, step_by_step
from benchctl.reports.results import make_folder, name_of, source_digest
from benchctl_instruments.errors import UsageError

REPORT = "comparison.html"
LAB, NEW = "the lab's model", "the new model"
_MOST_ALONE, _MOST_LINES = 5, 12
_BYTES_A_ROW = 350
"""What a comparison of two recordings holds at its peak, measured."""
_OVERLAID = (
    "Steps are laid over each other by the encoder's rate; what the motions still differ by is taken off by the scale "
    "factor. The noise is that of both recordings."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """Where a recording and its simulations part, and what a report says of the recording."""

    parting: Parting
    recording: str
    meta: Meta
    infos: tuple[StepInfo, ...]
    digest: str
    unit: str
    remarks: tuple[str, ...]


def compare_recordings(simulated: Path, real: Path) -> Compared:
    """Two recordings of one procedure; `UsageError` where one cannot be read, or they share no step or every sample."""
    with open_recording(simulated) as theirs, open_recording(real) as ours:
        if theirs.digest and theirs.digest == ours.digest:
            raise UsageError(f"{simulated}, {real}: the samples are the same, they part nowhere; name two recordings")
        rows = sum(info.samples for info in (*ours.infos, *theirs.infos))
        require_memory(real, _BYTES_A_ROW * rows, f"laying it and {simulated} over each other")
        steps, alone = with_recording(frame_of(ours), frame_of(theirs), name_of(simulated))
        remarks = [
            *alone[:_MOST_ALONE],
            *([f"and {len(alone) - _MOST_ALONE} more"] if len(alone) > _MOST_ALONE else []),
        ]
        return Compared(
            parting=part(steps),
            recording=name_of(real),
            meta=ours.meta,
            infos=ours.infos,
            digest=source_digest(ours),
            unit=text.unit_text(ours.meta.output_unit),
            remarks=(_OVERLAID, *remarks),
        )


def compare_with_models(path: Path, model: Path | None) -> Compared:
    """A recording, the model that it names, and another model beside it where one is given.

    Raises `UsageError` where the recording or the file cannot be read, or there is no model at all.
    """
    with open_recording(path) as recording:
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
        return Compared(
            parting=part(steps),
            recording=name_of(path),
            meta=recording.meta,
            infos=recording.infos,
            digest=source_digest(recording),
            unit=text.unit_text(recording.meta.output_unit),
            remarks=not_all_rows(frame),
        )


def values(compared: Compared) -> dict[str, Any]:
    """What `--json` says of a comparison."""
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
    """The comparison in a short table: overall, and the steps that part most."""
    parting, unit = compared.parting, compared.unit
    furthest = sorted(parting.steps, key=lambda step: -step.rms_v[parting.simulations[0]])[:_MOST_LINES]
    lines = [*compared.remarks, sentence(parting, unit)]
    header = "".join(f"{name:>24}" for name in parting.simulations)
    lines.append(f"{'step, rms of measured less simulated':<40}{header}{'noise':>12}")
    for step in furthest:
        told = "".join(f"{words.size(step.rms_v[name], unit):>24}" for name in parting.simulations)
        lines.append(f"{step.name:<40}{told}{words.size(step.noise_v, unit):>12}")
    if len(parting.steps) > len(furthest):
        lines.append(f"and {len(parting.steps) - len(furthest)} steps that part less")
    return "\n".join(lines)


def write_compared(compared: Compared, folder: Path) -> Path:
    """Write the report, whole or not at all; raises `UsageError` where the folder may not be written to."""
    make_folder(folder)
    page = comparison_page(
        compared.parting,
        compared.recording,
        compared.meta,
        compared.infos,
        digest=compared.digest,
        unit=compared.unit,
        remarks=compared.remarks,
    )
    write_page(folder / REPORT, page)
    return folder / REPORT


_LEVELS = ("raw", "joint", "stage_2")
_COLUMNS = 3
_MOST_ROWS = 20


def comparison_page(
    parting: Parting,
    recording: str,
    meta: Meta,
    infos: Sequence[StepInfo],
    *,
    digest: str,
    unit: str,
    remarks: Sequence[str] = (),
) -> str:
    """The page as text; the same input gives the same bytes. `remarks` is what a reader must know of the comparison."""
    furthest = sorted(parting.steps, key=lambda step: -step.rms_v[parting.simulations[0]])
    return render(
        "comparison.html.j2",
        parting=parting,
        recording=recording,
        meta=meta,
        sentence=sentence(parting, unit),
        noise=words.size(parting.noise_v, unit),
        tiles=[
            (level, name, words.size(rms, unit), words.times_noise(rms, parting.noise_v))
            for level, (name, rms) in zip(_LEVELS, parting.rms_v.items(), strict=False)
        ],
        remarks=remarks,
        drawings=_drawings(parting, unit),
        rows=[_row(step, parting.simulations, unit) for step in furthest[:_MOST_ROWS]],
        left_out=len(furthest[_MOST_ROWS:]),
        setup=setup_section.facts(meta, infos),
        provenance_rows=setup_section.provenance(meta, digest),
    )


def sentence(parting: Parting, unit: str) -> str:
    """How far each simulation is off, beside the noise."""
    told = " and ".join(
        f"{words.size(rms, unit)} from {name} ({words.times_noise(rms, parting.noise_v)})"
        for name, rms in parting.rms_v.items()
    )
    return f"The recording differs by {told}, rms over all samples."


def _row(step: StepParting, names: Sequence[str], unit: str) -> dict[str, object]:
    return {
        "name": step.name,
        "kind": setup_section.kind_name(step.kind),
        "differences": tuple(f"{words.size(step.rms_v[n], unit)} ({words.size(step.mean_v[n], unit)})" for n in names),
        "noise": words.size(step.noise_v, unit),
    }


def _drawings(parting: Parting, unit: str) -> Mapping[str, Drawing]:
    looks = {
        name: Look(label=name, colour=LEVEL_COLOURS[level], marker=LEVEL_MARKERS[level])
        for name, level in zip(parting.simulations, _LEVELS, strict=False)
    }
    names = " and ".join(looks)
    with style():
        return {
            "steps": Drawing(
                svg=inline_svg(_steps_figure(parting, looks, unit), "steps"),
                alt=f"Difference of every step from {names}, in the order of time.",
                caption="Rms of measured less simulated in every step, on a logarithmic scale.",
            ),
            "along": Drawing(
                svg=inline_svg(_along_figure(parting, looks, unit), "along"),
                alt=f"Mean difference from {names} along time, rate, acceleration, angle, temperature and output.",
                caption="Mean of measured less simulated in bins along each coordinate; bars: what white noise makes "
                "of a mean.",
            ),
            "excerpts": Drawing(
                svg=inline_svg(_excerpts_figure(parting, looks, unit), "excerpts"),
                alt=f"Excerpts of the steps that are furthest from {names}.",
                caption="Excerpts of the steps that are furthest off. Left: the outputs. Right: measured less "
                "simulated, with means as lines.",
            ),
        }


def _steps_figure(parting: Parting, looks: Mapping[str, Look], unit: str) -> Figure:
    figure = new_figure(2.4)
    marks = [StepMark(t_start=step.t_start) for step in parting.steps]
    rms = [(look, np.array([step.rms_v[name] for step in parting.steps])) for name, look in looks.items()]
    step_by_step(figure.subplots(), marks, rms, parting.noise_v, unit, "")
    return figure


def _along_figure(parting: Parting, looks: Mapping[str, Look], unit: str) -> Figure:
    rows = math.ceil(len(parting.coordinates) / _COLUMNS)
    figure = new_figure(0.35 + 1.5 * rows)
    panels = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    for axes, of in zip(panels, parting.coordinates, strict=False):
        means = [(look, of.mean_v[name]) for name, look in looks.items()]
        along(axes, of.coordinate, of.edges, means, of.standard_error_v, unit)
    for axes in panels[len(parting.coordinates) :]:
        axes.set_axis_off()
    figure.legend(handles=[look.key for look in looks.values()], loc="outside upper center", ncols=len(looks))
    return figure


def _excerpts_figure(parting: Parting, looks: Mapping[str, Look], unit: str) -> Figure:
    figure = new_figure(0.35 + 1.55 * len(parting.excerpts))
    grid = figure.subplots(len(parting.excerpts), 2, squeeze=False, width_ratios=(1.0, 1.8))
    for (output, left), of in zip(grid, parting.excerpts, strict=True):
        models = [(look, of.simulated_v[name]) for name, look in looks.items()]
        excerpt(output, left, of.time_s, of.measured_v, models, text.unit_text(unit))
        output.set_title(of.step)
    name_excerpts(figure, [look.key for look in looks.values()])
    return figure
