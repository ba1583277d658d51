"""A proof as short lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from benchctl.proof.classes import CLASSES
from benchctl.proof.summary import ArmFigures, ClassRow, Share, Summary


def lines(summary: Summary) -> Iterator[str]:
    """The table by class, then what the answers come to over all trials."""
    beside = summary.generic is not None
    head = f"{'':<30} {'right':>12} {'verdict':>12}"
    yield head + (f" {'sparse regr.':>14}" if beside else "")
    for row in summary.classes:
        yield _class_line(row)
    yield ""
    yield from _figures("diagnosis", summary.physics)
    if summary.generic is not None:
        yield from _figures("sparse regression", summary.generic)


def lines_on(values: Mapping[str, Any]) -> Iterator[str]:
    """Trials on a real recording, by effect and over all; `values` as `--json` gives them."""
    yield f"untouched: {', '.join(values['untouched']) or 'nothing found'}"
    yield f"{'':<34} {'named':>10} {'smallest named':>16} {'largest missed':>16}   (rms, by what is left untouched)"
    for row in values["effects"]:
        sizes = ["" if row[name] is None else f"{row[name]:.2f}" for name in ("smallest_named", "largest_missed")]
        named = f"{row['named']:>4} of {row['trials']:<3}"
        yield f"{row['effect'].replace('_', ' '):<34} {named} {sizes[0]:>16} {sizes[1]:>16}"
    yield (
        f"named {percent(Share(count=values['named'], of=values['trials']))}; its own findings lost in {values['lost']}"
        f" trials, something made up in {values['made_up']}"
    )


def percent(share: Share) -> str:
    """A share as people read it: `29 of 30 (97 %)`."""
    return f"{share} ({100 * share.value:.0f} %)" if share.value is not None else "none"


def _class_line(row: ClassRow) -> str:
    line = f"{CLASSES[row.kind].says:<30} {row.right!s:>12} {row.verdict!s:>12}"
    return line if row.generic is None else f"{line} {row.generic!s:>14}"


def _figures(name: str, arm: ArmFigures) -> Iterator[str]:
    yield f"{name}: named {percent(arm.named)} of what was drawn, {arm.made_up} made up"
    yield f"  nothing missing, yet something named: {percent(arm.false_alarms)}"
    if arm.inside_ci95.of:
        yield (
            f"  parameters within 25 % of the truth: {percent(arm.near)}; within 10 %: {percent(arm.nearer)}; "
            f"inside their 95 % interval: {percent(arm.inside_ci95)}"
        )
    if arm.held_out is not None:
        yield f"  held-out residual over the noise: {arm.held_out:.3f} (median)"
    if arm.seconds is not None:
        memory = "" if arm.peak_bytes is None else f", at most {arm.peak_bytes / 2**20:.0f} MiB"
        yield f"  time for one answer: {arm.seconds:.1f} s (median){memory}"
    if arm.silent:
        yield f"  no answer in {arm.silent} trials"
