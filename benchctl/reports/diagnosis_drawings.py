"""The figures of a diagnosis with their captions, and in words for who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from benchctl.diagnosis.result import Diagnosis
from benchctl.reports import diagnosis_words as words
from benchctl.reports.diagnosis_figures import map_figure, significance, steps_figure, traces_figure
from benchctl.reports.figures import Drawing, inline_svg, style


def drawings(diagnosis: Diagnosis, unit: str) -> Mapping[str, Drawing]:
    """Those figures that there is something to draw for, by name: map, steps, traces."""
    found: dict[str, Drawing] = {}

    def add(name: str, figure: Figure, alt: str, caption: str) -> None:
        found[name] = Drawing(svg=inline_svg(figure, name), alt=alt, caption=caption)

    with style():
        if diagnosis.slices:
            add(
                "map",
                map_figure(diagnosis.slices, unit),
                f"Mean residual along each coordinate, before and after. {beyond_chance(diagnosis)}",
                "Mean residual in bins along each coordinate, with standard errors: faint, the model with its own "
                "parameters refitted; dark, with the findings. Grey: what chance does anywhere on this map one time "
                "in a hundred. Above each panel: the largest mean in standard errors, before → after; bold where one "
                "of them is beyond chance, red where the latter is.",
            )
        if diagnosis.steps:
            add(
                "steps",
                steps_figure(diagnosis.steps, diagnosis.fit.noise_v, unit),
                "Residual of every step in the order of time, as the model came, refitted, and with the findings.",
                "Rms of the residual of every step, on a logarithmic scale. Shaded: steps that were held out, which "
                "chose nothing and fitted nothing.",
            )
        if diagnosis.traces:
            add(
                "traces",
                traces_figure(diagnosis.traces, unit),
                "Excerpts of held-out steps: the output with both predictions, and what both leave.",
                "Excerpts where before and after differ most. Left: the output and both predictions, which can hardly "
                "be told apart at this scale. Right: what they leave, with means as lines.",
            )
    return found


def beyond_chance(diagnosis: Diagnosis) -> str:
    """Along which coordinates the residual is beyond chance, before and after."""
    before = [words.coordinate(s.coordinate) for s in diagnosis.slices if significance(s, s.before_v) > s.threshold]
    after = [words.coordinate(s.coordinate) for s in diagnosis.slices if significance(s, s.after_v) > s.threshold]
    told = f"Beyond chance before: {', '.join(before)}." if before else "Nothing is beyond chance before."
    return f"{told} After: {', '.join(after) or 'nothing'}."
