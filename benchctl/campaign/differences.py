"""Compare two campaigns of one procedure, in sentences for errors and reports.

`differences` compares two finished runs, in groups. `refuse_another` and `refuse_other_instruments` compare a campaign
that is to be resumed with its start: procedure, unit, bench, instruments.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.provenance import recorded_bench, table_of
from benchctl.documents import toml_document
from benchctl.limits import cut, shown
from benchctl.plan import Plan
from benchctl.recordings.model import Meta, StepInfo
from benchctl_instruments.chambers.profile import parse_profile
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Identity

_LONGEST_WORD = 200


def flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables, and lists of tables, as one table with dotted names."""
    found: dict[str, Any] = {}
    for name, value in tables.items():
        if isinstance(value, list) and any(isinstance(item, dict) for item in value):
            value = {str(place): item for place, item in enumerate(value)}
        if isinstance(value, dict):
            found |= flat(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def changes(prefix: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each name whose value differs, or that is in one table only."""
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            yield changed(f"{prefix}{name}", before.get(name), now.get(name))


def changed(what: str, before: object, now: object) -> str:
    """Return `what was 5, is 6`; None is written as `not there`, an empty text as `empty`."""
    return f"{what} was {_word(before)}, is {_word(now)}"


def _word(value: object) -> str:
    if value is None:
        return "not there"
    return "empty" if value == "" else cut(str(value), _LONGEST_WORD)


_MOST_LINES = 20
_MOST_COMPARED = 2000
"""Maximum number of lines compared; the time of a comparison grows with their square."""
_CONTEXT = 1
_LONGEST_LINE = 200
_OBEYED = ("physics", "effects")


@dataclass(frozen=True, slots=True, kw_only=True)
class Differences:
    """Sentences and lines of unified diffs for each group; empty if nothing differs."""

    procedure: tuple[str, ...]
    parameters: tuple[str, ...]
    bench: tuple[str, ...]
    instruments: tuple[str, ...]
    software: tuple[str, ...]
    operator: tuple[str, ...]


def differences(first: Meta, again: Meta, *, expected: Collection[str] = ()) -> Differences:
    """Return the differences between a first run and its repetition.

    `expected` are dotted names of simulation settings that were chosen for the second run; they are not reported.
    Raises `UsageError` if the provenance of one run is damaged.
    """
    both = (first, again)
    reached = [{"reached": meta.provenance.get("instruments_reached", "")} for meta in both]
    instruments = [_table(meta, "instruments") | how for meta, how in zip(both, reached, strict=True)]
    before, now = first.provenance, again.provenance
    return Differences(
        procedure=tuple(_of_procedure(before, now)),
        parameters=tuple(changes("", _table(first, "parameters"), _table(again, "parameters"))),
        bench=tuple(_of_bench(first, again, expected)),
        instruments=tuple(changes("", *instruments)),
        software=tuple(changes("", _table(first, "software"), _table(again, "software"))),
        operator=tuple(changes("", _only(before, "operator"), _only(now, "operator"))),
    )


def _of_procedure(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    yield from changes("", _only(before, "procedure"), _only(now, "procedure"))
    digests = [provenance.get("procedure_sha256", "")[:12] or None for provenance in (before, now)]
    if digests[0] != digests[1]:
        yield changed("its source (SHA-256)", *digests)
        yield from _diff(before.get("procedure_source", ""), now.get("procedure_source", ""))


def _of_bench(first: Meta, again: Meta, expected: Collection[str]) -> Iterator[str]:
    before, now = first.provenance, again.provenance
    for name in ("bench_toml", "chamber_profile"):
        yield from _diff(before.get(name, ""), now.get(name, ""))
    yield from _of_obeyed(first, again, expected)


def _of_obeyed(first: Meta, again: Meta, expected: Collection[str]) -> Iterator[str]:
    """Yield differences in simulation settings that are not stated in the bench files, such as the seed."""
    obeyed = [flat({name: _table(meta, f"bench_{name}") for name in _OBEYED}) for meta in (first, again)]
    stated = [_said(meta) for meta in (first, again)]
    differing = {
        name
        for table, text in zip(obeyed, stated, strict=True)
        for name in table.keys() | text.keys()
        if table.get(name) != text.get(name)
    }
    before, now = ({name: table.get(name) for name in differing - set(expected)} for table in obeyed)
    yield from changes("", before, now)


def _said(meta: Meta) -> dict[str, Any]:
    """Return the same tables as stated in bench.toml; empty if no settings were recorded or it cannot be read."""
    if not meta.provenance.get("bench_physics"):
        return {}
    try:
        tables = toml_document(meta.provenance.get("bench_toml", ""), "bench.toml")
    except UsageError:
        return {}
    return flat({name: tables.get(name, {}) for name in _OBEYED})


def _diff(before: str, now: str) -> Iterator[str]:
    """Yield a short unified diff without its header; nothing if the texts are equal."""
    if before == now:
        return
    lines = before.splitlines(), now.splitlines()
    if max(map(len, lines)) > _MOST_COMPARED:
        yield f"differs, and is too long to be compared: {len(lines[0])} lines, and {len(lines[1])}"
        return
    found = list(difflib.unified_diff(*lines, n=_CONTEXT, lineterm=""))[2:]
    yield from (cut(line, _LONGEST_LINE) for line in found[:_MOST_LINES])
    if len(found) > _MOST_LINES:
        yield f"… and {len(found) - _MOST_LINES} more lines"
    if not found:
        yield "differs in the ends of its lines only"


def _table(meta: Meta, name: str) -> dict[str, Any]:
    return flat(table_of(meta, name, "the first run"))


def _only(provenance: Mapping[str, str], name: str) -> dict[str, str]:
    """Return this entry alone; empty if it is missing or empty."""
    return {name: provenance[name]} if provenance.get(name) else {}


_MAY_CHANGE = {"name", "operator", "time_factor", "interlocks", "faults", "notify", "laboratory", "released"}
"""Parts of bench.toml that may change on resume: operator, laboratory, speed, monitoring, messages and what the live
page may start, which do not affect measured data."""

_MAY_CHANGE_IN_A_TABLE = {
    "address",
    "stream_address",
    "silence_s",
    "hang_s",
    "motion_error_dps",
    "motion_error_percent",
}
"""Fields of its tables that may change: addresses, timeouts and monitoring limits of the instruments."""

_MAY_CHANGE_OF_PROFILE: dict[str, Any] = {
    "name": True,
    "source": True,
    "transport": {"unit_id", "baud", "pause_s", "timeout_s"},
}
"""Parts of a profile that may change: texts, and how the controller is addressed and waited for."""

_NAMED_AT_MOST = 3
_CAMPAIGN = "the campaign"


def refuse_another(meta: Meta, infos: Mapping[int, StepInfo], plan: Plan, bench: Bench) -> None:
    """Raise `UsageError` if procedure, parameters, unit, bench or a recorded step differ from the campaign's start."""
    _refuse("this is not the campaign that was begun", list(_differences(meta, infos, plan, bench)))


def refuse_other_instruments(meta: Meta, identities: Mapping[str, Identity]) -> None:
    """Raise `UsageError` if an instrument reports another model or serial number than at the campaign's start."""
    begun = flat(table_of(meta, "instruments", _CAMPAIGN))
    found = [
        f"{name}: {what} was {shown(before)}, is {shown(now)}"
        for name, identity in identities.items()
        for what in ("model", "serial")
        if (before := begun.get(f"{name}.{what}")) and (now := getattr(identity, what)) and before != now
    ]
    _refuse("another instrument answers", found)


def _differences(meta: Meta, infos: Mapping[int, StepInfo], plan: Plan, bench: Bench) -> Iterator[str]:
    provenance = meta.provenance
    if provenance.get("procedure") != plan.procedure:
        yield changed("procedure", provenance.get("procedure"), plan.procedure)
        return
    if provenance.get("procedure_sha256") != (digest := hashlib.sha256(plan.source.encode()).hexdigest()):
        yield changed("source of the procedure (SHA-256)", str(provenance.get("procedure_sha256"))[:12], digest[:12])
    yield from changes("parameter ", table_of(meta, "parameters", _CAMPAIGN), _plain(dict(plan.parameters)))
    if meta.unit.serial != bench.unit.serial:
        yield changed("unit.serial", meta.unit.serial, bench.unit.serial)
    yield from changes("", _compared(recorded_bench(meta, _CAMPAIGN)), _compared(bench))
    for number, step in enumerate(plan.steps, 1):
        info = infos.get(number)
        if info is not None and (info.kind != step.kind or not info.name.startswith(step.label)):
            yield changed(f"step {number}", info.name, step.label)


def _compared(bench: Bench) -> dict[str, Any]:
    """Return what must be equal on a bench, by dotted names; a chamber profile is compared by content, not by path."""
    tables = _plain(bench.model_dump(mode="json", exclude=_MAY_CHANGE))
    if bench.chamber_profile:
        profile = parse_profile(bench.chamber_profile, "the chamber profile of the campaign")
        tables["chamber"]["model"] = "a profile"
        tables["chamber_profile"] = profile.model_dump(mode="json", exclude=_MAY_CHANGE_OF_PROFILE)
    found = flat(tables)
    for table in tables:
        for field in _MAY_CHANGE_IN_A_TABLE:
            found.pop(f"{table}.{field}", None)
    return found


def _plain(value: Any) -> Any:
    """Return a value after a round trip through JSON."""
    return json.loads(json.dumps(value))


def _refuse(what: str, found: list[str]) -> None:
    if found:
        more = f" (and {len(found) - _NAMED_AT_MOST} more)" if len(found) > _NAMED_AT_MOST else ""
        raise UsageError(
            f"--resume: {what}: {'; '.join(found[:_NAMED_AT_MOST])}{more}; give it back what it began with, or run anew"
        )
