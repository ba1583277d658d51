"""Read recordings and documents for the index: only descriptions, no samples; all contents are validated."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchctl.calibration.coefficients import read_coefficients
from benchctl.documents import read_json
from benchctl.history.series import Campaign, Document, Figure, Source
from benchctl.limits import cut, shown
from benchctl.recordings.descriptions import read_meta
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import attribute
from benchctl_instruments.errors import UsageError

ACCEPTANCE = "benchctl-acceptance/1"
_LEVELS = ("raw", "stage_1", "stage_2", "joint")
_OF_THE_BENCH = "encoder_"
"""Prefix of parameters that belong to the bench and not to the unit."""
_LONGEST = 120
_MOST_FIGURES = 10_000
_SMALLEST, _LARGEST = 1e-100, 1e100
"""Range of values; smaller ones are zero. Their squares and differences are ordinary numbers."""


def read_campaign(path: Path, key: str) -> Campaign:
    """Read a recording's root attributes; `UsageError` if they are unreadable or without the time of recording."""
    with open_ours(path) as file:
        try:
            meta, digest = read_meta(file), attribute(file, "digest", "")
        except ValueError as err:
            raise UsageError(f"its description is damaged ({err}); benchctl verify names what changed") from err
    return Campaign(
        path=key,
        serial=words(meta.unit.serial),
        model=words(meta.unit.model),
        procedure=words(meta.provenance.get("procedure", "")),
        started_utc=_moment(meta.provenance.get("started_utc", "")),
        status=words(meta.status),
        digest=words(digest),
        parameters=_parameters(meta.provenance.get("parameters", "")),
    )


def read_document(path: Path, source: Source) -> Document:
    """Read the figures that a file states; `UsageError` if it is not a benchctl file or malformed."""
    return _coefficients(path) if source == "coefficients" else _acceptance(path)


def _parameters(text: str) -> str:
    """Return the parameters of a procedure in normalized JSON; empty if the text is not a JSON object."""
    try:
        found = json.loads(text)
    except ValueError:
        return ""
    return json.dumps(found, sort_keys=True) if isinstance(found, dict) else ""


def words(text: object) -> str:
    """Return a text for display, also in a terminal: without control characters, not longer than a line."""
    return cut("".join(sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in str(text)), _LONGEST)


def _coefficients(path: Path) -> Document:
    content = read_coefficients(path)
    parameters = _table(content, "uncertainty", "parameters") or {}
    celsius = _number(content, "T0_c")
    figures = [
        Figure(
            name=words(name),
            unit=words(parameter.get("unit") or ""),
            value=value,
            uncertainty=_number(parameter, "expanded"),
            temperature_c=celsius,
        )
        for name in parameters
        if not name.startswith(_OF_THE_BENCH)
        and (parameter := _table(parameters, name)) is not None
        and (value := _number(parameter, "value")) is not None
    ]
    errors = _table(content, "error_percent") or {}
    figures += [
        Figure(name=f"error_percent.{level}", unit="%", value=value)
        for level in _LEVELS
        if (value := _number(errors, level)) is not None
    ]
    digests = [words(one.get("digest", "")) for one in _tables(content, "source")]
    return Document(source="coefficients", digests=tuple(filter(None, digests)), verdict="", figures=_limited(figures))


def _acceptance(path: Path) -> Document:
    content = read_json(path, "acceptance")
    if not isinstance(content, dict) or content.get("schema") != ACCEPTANCE:
        found = content.get("schema") if isinstance(content, dict) else content
        raise UsageError(f"expected schema {ACCEPTANCE!r}, found {shown(found)}; write it with `benchctl accept`")
    tests = [(test, value) for test in _tables(content, "tests") if (value := _number(test, "value")) is not None]
    often = Counter(str(test.get("name")) for test, _ in tests)
    figures = [_tested(test, value, repeated=often[str(test.get("name"))] > 1) for test, value in tests]
    digest = content.get("recording_digest") or ""
    return Document(
        source="acceptance",
        digests=(words(digest),) if digest else (),
        verdict=words(content.get("verdict") or ""),
        figures=_limited(figures),
    )


def _tested(test: Mapping[str, Any], value: float, *, repeated: bool) -> Figure:
    """Return a test as a figure; one done at several temperatures is a figure at each, to the nearest degree."""
    celsius = _number(test, "temperature_c")
    at = f" at {round(celsius)} °C" if repeated and celsius is not None else ""
    limit = _table(test, "limit") or {}
    unit = words(test.get("unit") or "")
    same = words(limit.get("unit") or "") == unit
    return Figure(
        name=words(test.get("name") or "unnamed") + at,
        unit=unit,
        value=value,
        uncertainty=_number(test, "uncertainty"),
        temperature_c=celsius,
        bound=words(test.get("bound") or ""),
        verdict=words(test.get("verdict") or ""),
        low=_number(limit, "low") if same else None,
        high=_number(limit, "high") if same else None,
    )


def _limited(figures: list[Figure]) -> tuple[Figure, ...]:
    """Return the figures without duplicate names, keeping the first."""
    if len(figures) > _MOST_FIGURES:
        raise UsageError(f"states {len(figures)} figures, expected at most {_MOST_FIGURES}")
    return tuple({figure.name: figure for figure in reversed(figures)}.values())[::-1]


def _moment(text: str) -> str:
    """Return a time in UTC to the second; a time without an offset is UTC."""
    if not text:
        raise UsageError("does not say when it was made (`started_utc`), as imported recordings may; it is not counted")
    try:
        moment = datetime.fromisoformat(text)
        moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    except (ValueError, OverflowError) as err:
        raise UsageError(f"states that it was made at {shown(text)}, expected ISO 8601; it is not counted") from err
    return moment.isoformat(timespec="seconds")


def _number(table: Mapping[str, Any], name: str) -> float | None:
    """Return a finite number, or None for null, NaN and a missing entry; `UsageError` for anything else."""
    value = table.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UsageError(f"{words(name)} is {shown(value)}, expected a number")
    if not math.isfinite(value):
        return None
    if abs(value) > _LARGEST:
        raise UsageError(f"{words(name)} is {shown(value)}, expected at most {_LARGEST:g} in size")
    return float(value) if abs(value) >= _SMALLEST else 0.0


def _table(content: Mapping[str, Any], *names: str) -> dict[str, Any] | None:
    """Return a nested table, or None if there is none; `UsageError` if it is anything else."""
    found: Any = content
    for name in names:
        found = found.get(name)
        if found is None:
            return None
        if not isinstance(found, dict):
            raise UsageError(f"{words(name)} is {shown(found)}, expected a table")
    return found  # type: ignore[no-any-return]  # a dict by now, or `names` is empty


def _tables(content: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    found = content.get(name) or []
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise UsageError(f"{name} is {shown(found)}, expected a list of tables")
    return found
