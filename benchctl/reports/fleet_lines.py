"""A fleet for a terminal: a few lines, whatever its size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from benchctl.reports import text
from benchctl.reports.fleet_facts import Fleet, diagnosed, judged, label, recurring, spreads

_MOST = 20
"""Failures, and figures apart, that a reader is shown; the report has all."""


def lines(fleet: Fleet) -> Iterator[str]:
    """How many were done; what failed; who stands apart; which physics recurs; which tests do not pass."""
    counts = {state: len(fleet.ended(state)) for state in ("done", "kept", "failed")}
    told = [f"{counts['done']} done", f"{counts['kept']} unchanged since they were done", f"{counts['failed']} failed"]
    left = [f"{fleet.left} left"] if fleet.left else []
    total = len(fleet.members) + fleet.left
    yield f"{fleet.verb} of {total} {'recording' if total == 1 else 'recordings'}: {', '.join([*told, *left])}"
    yield from _first([f"failed: {member.says}" for member in fleet.ended("failed")])
    yield from _first(
        [
            f"apart: {spread.name} of {label(member)}: {text.with_unit(text.number(figure.value, 5), spread.unit)}, "
            f"median {text.number(spread.median, 5)}, robust z = {text.number(z, 2)}"
            for spread in spreads(fleet)
            for member, figure, z in spread.apart
        ]
    )
    if of := diagnosed(fleet):
        verdicts = Counter(member.stated["diagnose"].verdict for member in of)
        yield f"diagnoses: {', '.join(f'{count} {verdict}' for verdict, count in verdicts.most_common())}"
        yield from _first([f"  {one.effect} in {one.count} of {len(of)}" for one in recurring(fleet)])
    accepted = [member.stated["accept"].verdict for member in fleet.members if "accept" in member.stated]
    if accepted:
        yield f"acceptances: {', '.join(f'{count} {verdict}' for verdict, count in Counter(accepted).most_common())}"
    yield from _first(
        [
            f"  {name}: {len(by['FAIL'])} FAIL, {len(by['INCONCLUSIVE'])} INCONCLUSIVE, {len(by['PASS'])} PASS"
            for name, by in judged(fleet).items()
            if by["FAIL"] or by["INCONCLUSIVE"]
        ]
    )


def _first(told: list[str]) -> Iterator[str]:
    yield from told[:_MOST]
    if len(told) > _MOST:
        yield f"and {len(told) - _MOST} more such; the report has all"
