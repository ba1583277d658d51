"""A fleet as programs are told it: `fleet.json`, and what `--json` says."""

from __future__ import annotations

import json
import statistics
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.reports.fleet_facts import Fleet, Member, Recurring, Spread, diagnosed, judged, recurring, spreads

SCHEMA = "benchctl-fleet/1"


def fleet_values(fleet: Fleet) -> dict[str, Any]:
    """Plain data; recordings are named by their paths or URLs."""
    return {
        "verb": fleet.verb,
        "recordings": {
            "total": len(fleet.members) + fleet.left,
            **{state: len(fleet.ended(state)) for state in ("done", "kept", "failed")},
            "left": fleet.left,
        },
        "members": [_member(member) for member in fleet.members],
        "failures": [{"recording": one.recording, "says": one.says} for one in fleet.ended("failed")],
        "figures": [_spread(spread) for spread in spreads(fleet)],
        "effects": [_recurring(one, len(diagnosed(fleet))) for one in recurring(fleet)],
        "tests": [
            {"name": name, **{verdict: [one.recording for one in members] for verdict, members in by_verdict.items()}}
            for name, by_verdict in judged(fleet).items()
        ],
    }


def write_fleet_file(path: Path, fleet: Fleet) -> None:
    """Write the file, whole or not at all; `UsageError` where the disk refuses."""
    with whole_file(path) as temporary:
        content = {"schema": SCHEMA, **fleet_values(fleet)}
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        temporary.write_text(f"{text}\n", encoding="utf-8")


def _member(member: Member) -> dict[str, Any]:
    return {
        "recording": member.recording,
        "unit": member.serial,
        "model": member.model,
        "state": member.state,
        "says": member.says,
        "verdicts": {verb: stated.verdict for verb, stated in member.stated.items() if stated.verdict},
        "reports": dict(member.reports),
    }


def _spread(spread: Spread) -> dict[str, Any]:
    values, siblings = [figure.value for _, figure in spread.values], spread.siblings
    return {
        "name": spread.name,
        "unit": spread.unit,
        "model": spread.model,
        "from": spread.verb,
        "median": spread.median,
        "low": min(values),
        "high": max(values),
        "mad": siblings.mad if siblings else None,
        "limit": siblings.limit if siblings else None,
        "apart": [{"recording": one.recording, "value": figure.value, "z": z} for one, figure, z in spread.apart],
        "values": [
            {"recording": one.recording, "value": figure.value, "uncertainty": figure.uncertainty}
            for one, figure in spread.values
        ],
    }


def _recurring(one: Recurring, of: int) -> dict[str, Any]:
    first = next((effect.parameters[0] for _, effect in one.found if effect.parameters), None)
    return {
        "effect": one.effect,
        "found": one.count,
        "of": of,
        "parameter": first.name if first else None,
        "unit": first.unit if first else None,
        "median": statistics.median(one.sizes) if one.sizes else None,
        "low": min(one.sizes, default=None),
        "high": max(one.sizes, default=None),
        "recordings": [
            {
                "recording": member.recording,
                "explains": effect.explains,
                "parameters": [asdict(parameter) for parameter in effect.parameters],
            }
            for member, effect in one.found
        ],
    }
