"""Folders of campaigns with small real recordings, and what `fit` and `accept` would state of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchctl.history.history import Charted, History, UnitHistory, history_of
from benchctl.recordings.model import Unit
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.recordings import made


def started(number: int) -> str:
    """The start of the n-th campaign: one a day."""
    return f"2026-{1 + number // 28:02d}-{1 + number % 28:02d}T08:00:00+00:00"


def recorded(
    path: Path,
    serial: str = "SN-1",
    started_utc: str = started(0),
    model: str = "VG910Q",
    rows: int = 20,
    **parameters: float,
) -> str:
    """Write a recording; its digest."""
    path.parent.mkdir(parents=True, exist_ok=True)
    provenance = {"procedure": "two_stage"} | ({"started_utc": started_utc} if started_utc else {})
    if parameters:
        provenance["parameters"] = json.dumps(parameters)
    unit = Unit(serial=serial, range_dps=150.0, model=model)
    write_recording(path, made.meta(unit=unit, provenance=provenance), [made.step(1, rows=rows)])
    with open_recording(path) as recording:
        return recording.digest


def fitted(parameters: Mapping[str, tuple[float, float | None]], *digests: str, **more: Any) -> str:
    """The text of coefficients: by name a value and its expanded uncertainty."""
    content: dict[str, Any] = {
        "schema": "benchctl-coefficients/1",
        "convention": "correction",
        "argument": "indicated",
        "K0_v_per_dps": 0.05,
        "U0_v": 0.0,
        "T0_c": 20.0,
        "stages": [{}],
        "uncertainty": {
            "k": 2,
            "parameters": {
                name: {"value": value, "unit": "V", "expanded": expanded}
                for name, (value, expanded) in parameters.items()
            },
        },
        "source": [{"recording": "recording.h5", "digest": digest} for digest in digests],
        "error_percent": {},
    }
    return json.dumps(content | more)


def one_test(name: str = "bias", value: float | None = 1.0, **more: Any) -> dict[str, Any]:
    """One test of an acceptance."""
    test = {"name": name, "value": value, "unit": "deg/h", "uncertainty": 0.1, "limit": None, "verdict": None}
    return test | {"bound": "", "refused": None, "temperature_c": 20.0} | more


def accepted(tests: Sequence[Mapping[str, Any]], digest: str, verdict: str = "PASS") -> str:
    """The text of an acceptance."""
    return json.dumps(
        {"schema": "benchctl-acceptance/1", "verdict": verdict, "tests": tests, "recording_digest": digest}
    )


def campaign(
    folder: Path,
    serial: str = "SN-1",
    number: int = 0,
    K0: float | None = 0.05,
    U: float | None = 1e-5,
    **parameters: float,
) -> Path:
    """A campaign with a recording and, where there is a K0, its coefficients."""
    place = folder / f"{number:03d}_{serial}"
    digest = recorded(place / "recording.h5", serial, started(number), **parameters)
    if K0 is not None:
        (place / "coefficients.json").write_text(fitted({"K0_v_per_dps": (K0, U)}, digest))
    return place


def digest_in(place: Path) -> str:
    with open_recording(place) as recording:
        return recording.digest


def read(folder: Path) -> History:
    """A history whose index gave nothing to say."""
    said: list[str] = []
    history = history_of(folder, str(folder), said.append)
    assert said == []
    return history


def only(history: History) -> UnitHistory:
    (unit,) = history.units
    return unit


def figure(history: History, name: str = "K0_v_per_dps", serial: str = "SN-1") -> Charted:
    (found,) = [
        one for unit in history.units if unit.serial == serial for one in unit.figures if one.series.name == name
    ]
    return found
