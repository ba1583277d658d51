"""A plan as a figure: the chamber's set point and the table's rate over bench time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchctl.atomic import whole_file
from benchctl.bench import Limits
from benchctl.campaign.timing import timeline
from benchctl.plan import Plan, Step
from benchctl.reports.figures import INK, new_figure, style
from benchctl.reports.setup_section import kind_name
from benchctl_instruments.errors import UsageError

KIND_COLOURS: Mapping[str, str] = {
    "soak": "#b9c0c7",
    "static": "#E69F00",
    "constant_rate": "#0072B2",
    "sine": "#009E73",
    "thermal_ramp": "#CC79A7",
    "power_cycle": "#D55E00",
    "mount": "#56B4E9",
    "ask": "#F0E442",
    "home": "#8C564B",
}
_BY_HAND: Mapping[str, str] = {
    "mount": "mounted by an operator",
    "ask": "done by an operator",
    "home": "homing",
}
_KEPT_ASIDE: dict[str, Any] = {"linestyle": "none", "marker": "v", "markersize": 4, "color": INK}
_FORMATS = (".svg", ".png")
_LEAST_WIDTH_SHARE = 0.001
"""Minimum width of a bar relative to the total duration, so that short steps remain visible."""


def timeline_figure(plan: Plan, spans: Sequence[tuple[float, float, float]]) -> Figure:
    """Plot set point and largest rate of each step, coloured by its kind; held-out runs have a mark.

    Parameters
    ----------
    plan
        The steps.
    spans
        For each step its start and end [s of bench time] and the chamber's set point [°C] at its end, as
        `benchctl.campaign.timing.timeline` gives them.
    """
    end_h = max((end for _, end, _ in spans), default=0.0) / 3600
    figure = new_figure(3.2)
    chamber, table = figure.subplots(2, 1, sharex=True)
    for step, (start, end, _) in zip(plan.steps, spans, strict=True):
        begin_h, width_h = start / 3600, max((end - start) / 3600, _LEAST_WIDTH_SHARE * end_h)
        if step.peak_rate_dps > 0:
            table.bar(begin_h, step.peak_rate_dps, width_h, align="edge", color=KIND_COLOURS[step.kind], linewidth=0)
        else:
            table.plot([begin_h, begin_h + width_h], [0, 0], color=KIND_COLOURS[step.kind], linewidth=3)
        if _is_kept_aside(step):
            table.plot(begin_h + width_h / 2, 1.06 * step.peak_rate_dps, **_KEPT_ASIDE)
    edges_h = [edge / 3600 for start, end, _ in spans for edge in (start, end)]
    chamber.plot(edges_h, [setpoint_c for *_, setpoint_c in spans for _ in range(2)], color=INK, linewidth=1.0)
    chamber.set_ylabel("chamber's set point (°C)")
    table.set(ylabel="largest |rate| (°/s)", xlabel="bench time (h)", xlim=(0, end_h or 1))
    figure.align_ylabels([chamber, table])
    figure.legend(handles=_legend(plan.steps), loc="outside upper center", ncols=6)
    return figure


def draw_timeline(path: Path, plan: Plan, limits: Limits, from_c: float) -> None:
    """Draw a plan into an SVG or PNG file; the chamber starts at `from_c`.

    Raises `UsageError` for another kind of file, or if it cannot be written.
    """
    if path.suffix.lower() not in _FORMATS:
        raise UsageError(f"{path}: a picture is written as {' or '.join(_FORMATS)}; name it so")
    with style(), mpl.rc_context({"svg.hashsalt": "timeline"}), whole_file(path) as temporary:
        figure = timeline_figure(plan, list(timeline(plan, limits, from_c)))
        dates = {"Date": None} if path.suffix.lower() == ".svg" else {}
        figure.savefig(temporary, format=path.suffix.lower()[1:], dpi=150, metadata=dates)


def _is_kept_aside(step: Step) -> bool:
    return getattr(step, "role", "fit") == "verify"


def _legend(steps: Sequence[Step]) -> list[Artist]:
    kinds = [kind for kind in KIND_COLOURS if any(step.kind == kind for step in steps)]
    handles: list[Artist] = [
        Patch(color=KIND_COLOURS[kind], label=_BY_HAND.get(kind, kind_name(kind))) for kind in kinds
    ]
    if any(_is_kept_aside(step) for step in steps):
        handles.append(Line2D([], [], label="kept aside for verification", **_KEPT_ASIDE))
    return handles
