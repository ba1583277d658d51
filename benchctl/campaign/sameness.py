"""Whether a campaign that is to go on is still the same one: procedure, unit, bench, instruments."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.changes import changed, changes, flat
from benchctl.campaign.provenance import recorded_bench, table_of
from benchctl.limits import shown
from benchctl.plan import Plan
from benchctl.recordings.model import Meta, StepInfo
from benchctl_instruments.chambers.profile_file import parse_profile
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Identity

_MAY_CHANGE = {"name", "operator", "time_factor", "interlocks", "faults"}
"""Tables of bench.toml that say who runs it, how fast and how it is watched: nothing of what is measured."""

_MAY_CHANGE_IN_A_TABLE = {
    "address",
    "stream_address",
    "silence_s",
    "hang_s",
    "motion_error_dps",
    "motion_error_percent",
}
"""Fields of its tables that say how an instrument is reached, waited for and watched."""

_MAY_CHANGE_OF_PROFILE: dict[str, Any] = {
    "name": True,
    "source": True,
    "transport": {"unit_id", "baud", "pause_s", "timeout_s"},
}
"""Words, and how the controller is reached and waited for."""

_NAMED_AT_MOST = 3
_CAMPAIGN = "the campaign"


def refuse_another(meta: Meta, infos: Mapping[int, StepInfo], plan: Plan, bench: Bench) -> None:
    """Raise `UsageError` where procedure, parameters, unit, bench or a recorded step differ from what was begun."""
    _refuse("this is not the campaign that was begun", list(_differences(meta, infos, plan, bench)))


def refuse_other_instruments(meta: Meta, identities: Mapping[str, Identity]) -> None:
    """Raise `UsageError` where an instrument states another model or serial number than when it was begun."""
    begun = flat(table_of(meta, "instruments", _CAMPAIGN))
    found = [
        f"{name}: {what} was {shown(before)}, is {shown(now)}"
        for name, identity in identities.items()
        for what in ("model", "serial")
        if (before := begun.get(f"{name}.{what}")) and (now := getattr(identity, what)) and before != now
    ]
    _refuse("another instrument answers", found)


def _differences(meta: Meta, infos: Mapping[int, StepInfo], plan: Plan, bench: Bench) -> Iterator[str]:
    told = meta.provenance
    if told.get("procedure") != plan.procedure:
        yield changed("procedure", told.get("procedure"), plan.procedure)
        return
    if told.get("procedure_sha256") != (digest := hashlib.sha256(plan.source.encode()).hexdigest()):
        yield changed("source of the procedure (SHA-256)", str(told.get("procedure_sha256"))[:12], digest[:12])
    yield from changes("parameter ", table_of(meta, "parameters", _CAMPAIGN), _plain(dict(plan.parameters)))
    if meta.unit.serial != bench.unit.serial:
        yield changed("unit.serial", meta.unit.serial, bench.unit.serial)
    yield from changes("", _compared(recorded_bench(meta, _CAMPAIGN)), _compared(bench))
    for number, step in enumerate(plan.steps, 1):
        info = infos.get(number)
        if info is not None and (info.kind != step.kind or not info.name.startswith(step.label)):
            yield changed(f"step {number}", info.name, step.label)


def _compared(bench: Bench) -> dict[str, Any]:
    """What must be the same of a bench, by dotted names; of a chamber's profile what it says, not where it lies."""
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
    """A value as JSON gives it back."""
    return json.loads(json.dumps(value))


def _refuse(what: str, found: list[str]) -> None:
    if found:
        more = f" (and {len(found) - _NAMED_AT_MOST} more)" if len(found) > _NAMED_AT_MOST else ""
        raise UsageError(
            f"--resume: {what}: {'; '.join(found[:_NAMED_AT_MOST])}{more}; give it back what it began with, or run anew"
        )
