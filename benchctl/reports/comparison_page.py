"""The HTML page that shows where a recording and its simulations differ."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from benchctl.diagnosis.comparison.parting import Parting, StepParting
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import diagnosis_words as words
from benchctl.reports import setup_section, text
from benchctl.reports.figures import LEVEL_COLOURS, LEVEL_MARKERS, Drawing, inline_svg, new_figure, style
from benchctl.reports.html import render
from benchctl.reports.mismatch_figures import Look, StepMark, along, excerpt, name_excerpts, step_by_step

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
    """Return the page as text. The same input gives the same bytes. `remarks` are notes on the comparison."""
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
    """Return a sentence with the rms difference of each simulation, in its unit and relative to the noise."""
    differences = " and ".join(
        f"{words.size(rms, unit)} from {name} ({words.times_noise(rms, parting.noise_v)})"
        for name, rms in parting.rms_v.items()
    )
    return f"The recording differs by {differences}, rms over all samples."


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
