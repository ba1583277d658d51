"""One campaign in detail: its plan, its steps, its channels, its limits and where it comes from."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from benchctl.dashboard.data.bench_limits import bench_of, limits_of
from benchctl.dashboard.data.channels import described
from benchctl.dashboard.data.contents import Piece, contents_of
from benchctl.dashboard.data.journal import lines_after
from benchctl.dashboard.data.run_state import RunState
from benchctl.recordings.model import Meta

_LONGEST = 300
"""Texts of the provenance that are longer are documents, such as bench.toml, and not for a table."""


def details_of(path: Path) -> dict[str, Any]:
    """Plan, steps, channels, end, limits, provenance, notes and digest of a campaign, for the page.

    `plan` has bench times as planned and, as `began_s`, when each step really began; it is empty where the recording
    keeps none. Times of `steps` are those of the recording. Raises `UsageError` where the campaign cannot be read.
    """
    contents = contents_of(path)
    state = RunState()
    state.take(event for _, event in lines_after(path, 0) if event is not None)
    names = dict.fromkeys(name for piece in contents.pieces for name in piece.channels)
    return {
        "plan": [step.as_json(state.begun.get(step.index)) for step in state.plan],
        "steps": [_step(piece) for piece in contents.pieces],
        "channels": described(names, contents.meta),
        "t_end_s": contents.t_end_s,
        "limits": [limit.as_json() for limit in limits_of(bench_of(contents.meta))],
        "provenance": _provenance(contents.meta),
        "notes": list(contents.notes),
        "digest": contents.digest,
    }


def _step(piece: Piece) -> dict[str, Any]:
    info = piece.info
    return {
        "index": info.index,
        "name": info.name,
        "kind": info.kind,
        "role": info.role,
        "whole": bool(info.whole),
        "t_start_s": info.t_start,
        "t_end_s": info.t_end,
        "samples": info.samples,
        "gaps": info.gaps,
        "rate_dps": info.rate_dps,
        "amplitude_dps": info.amplitude_dps,
        "frequency_hz": info.frequency_hz,
        "setpoint_c": info.chamber_setpoint_c if math.isfinite(info.chamber_setpoint_c) else None,
        "mounting": info.mounting,
    }


def _provenance(meta: Meta) -> dict[str, str]:
    """What is short enough to be shown."""
    return {name: told for name, told in meta.provenance.items() if told and len(told) <= _LONGEST}
