"""Whether a campaign that is to go on is still the same one: procedure, unit, bench, instruments."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

from benchctl.bench import Bench
from benchctl.plan import Plan
from benchctl.recordings.model import Meta, StepInfo
from benchctl.toml_file import parse_toml
from instruments.errors import UsageError
from instruments.interfaces import Identity

_MAY_CHANGE = {"name", "operator", "text", "time_factor", "interlocks", "faults"}
"""Tables of bench.toml that say who runs it, how fast and how it is watched: nothing of what is measured."""

_MAY_CHANGE_ANYWHERE = {"address", "stream_address", "silence_s", "hang_s"}
"""Fields that say how an instrument is reached and waited for."""

_NAMED_AT_MOST = 3


def bench_of(meta: Meta) -> Bench:
    """The bench that a campaign was begun on, as its recording keeps it; `UsageError` where it keeps none."""
    told = meta.provenance
    bench = parse_toml(told.get("bench_toml", ""), Bench, "the bench.toml of the campaign")
    obeyed = {name: json.loads(told[f"bench_{name}"]) for name in ("physics", "effects") if told.get(f"bench_{name}")}
    return bench.model_copy(update={**obeyed, "text": told["bench_toml"]})


def refuse_another(meta: Meta, infos: Mapping[int, StepInfo], plan: Plan, bench: Bench) -> None:
    """Raise `UsageError` where procedure, parameters, unit, bench or a recorded step differ from what was begun."""
    _refuse("this is not the campaign that was begun", list(_differences(meta, infos, plan, bench)))


def refuse_other_instruments(meta: Meta, identities: Mapping[str, Identity]) -> None:
    """Raise `UsageError` where an instrument states another model or serial number than when it was begun."""
    begun: dict[str, dict[str, str]] = json.loads(meta.provenance.get("instruments") or "{}")
    found = [
        f"{name}: {what} was {before!r}, is {now!r}"
        for name, identity in identities.items()
        for what in ("model", "serial")
        if (before := begun.get(name, {}).get(what)) and (now := getattr(identity, what)) and before != now
    ]
    _refuse("another instrument answers", found)


def _differences(meta: Meta, infos: Mapping[int, StepInfo], plan: Plan, bench: Bench) -> Iterator[str]:
    told = meta.provenance
    if told.get("procedure") != plan.procedure:
        yield _changed("procedure", told.get("procedure"), plan.procedure)
        return
    if told.get("procedure_sha256") != (digest := hashlib.sha256(plan.source.encode()).hexdigest()):
        yield _changed("source of the procedure (SHA-256)", str(told.get("procedure_sha256"))[:12], digest[:12])
    yield from _changes("parameter ", json.loads(told.get("parameters") or "{}"), _plain(dict(plan.parameters)))
    if meta.unit.serial != bench.unit.serial:
        yield _changed("unit.serial", meta.unit.serial, bench.unit.serial)
    yield from _changes("", _compared(bench_of(meta)), _compared(bench))
    for number, step in enumerate(plan.steps, 1):
        info = infos.get(number)
        if info is not None and (info.kind != step.kind or not info.name.startswith(step.label)):
            yield _changed(f"step {number}", info.name, step.label)


def _compared(bench: Bench) -> dict[str, Any]:
    """What must be the same of a bench, by dotted names."""
    tables = _plain(bench.model_dump(mode="json", exclude=_MAY_CHANGE))
    return {name: value for name, value in _flat(tables, "").items() if name.split(".")[-1] not in _MAY_CHANGE_ANYWHERE}


def _flat(tables: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in tables.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def _changes(prefix: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            yield _changed(f"{prefix}{name}", before.get(name), now.get(name))


def _changed(what: str, before: object, now: object) -> str:
    return f"{what} was {_word(before)}, is {_word(now)}"


def _word(value: object) -> str:
    return "not there" if value is None else str(value)


def _plain(value: Any) -> Any:
    """A value as JSON gives it back."""
    return json.loads(json.dumps(value))


def _refuse(what: str, found: list[str]) -> None:
    if found:
        more = f" (and {len(found) - _NAMED_AT_MOST} more)" if len(found) > _NAMED_AT_MOST else ""
        raise UsageError(f"--resume: {what}: {'; '.join(found[:_NAMED_AT_MOST])}{more}")
