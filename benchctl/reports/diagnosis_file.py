"""`diagnosis.json` beside the report: what `benchctl diagnose --json` says, of which recording, and a map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from benchctl.atomic import whole_file
from benchctl.diagnosis.result import COORDINATE_UNITS, Diagnosis, FloatArray, Slice
from benchctl.reports.diagnosis_words import estimate

_DIGITS = 6


def write_diagnosis_file(path: Path, diagnosis: Diagnosis, digest: str) -> None:
    """Write the file, whole or not at all; `digest` is that of the recording, or those of several, with commas.

    `map` has for each coordinate the edges of its bins, the mean residual in them before and after the findings, its
    standard error (None where a bin is empty), and how many of those chance alone reaches one time in a hundred.
    `stated` is a parameter as the report prints it. Raises `UsageError` where the disk refuses.
    """
    content = {
        **diagnosis.as_json(),
        "recording_digest": digest,
        "map": [_slice(one, diagnosis.fit.unit) for one in diagnosis.slices],
    }
    for told, finding in zip(content["findings"], diagnosis.findings, strict=True):
        for name, value in finding.parameters.items():
            told["parameters"][name]["stated"] = estimate(value)
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
