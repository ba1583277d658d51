"""One instrument asked who it is, by its own driver; and where that fails, why, as far as its wire tells."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple

from benchctl.bench import Bench, InstrumentEntry
from benchctl.campaign.opened import driver_at
from benchctl.doctor.finding import Finding, bad, ok
from benchctl.doctor.instruments.others import who_else
from benchctl.doctor.instruments.units import units_that_answer
from benchctl.doctor.network.reach import Reached, reach, reach_finding
from benchctl_instruments.catalog import Kind, driver
from benchctl_instruments.chambers.modbus_chamber import ModbusChamber
from benchctl_instruments.digitizers.labjack_t7 import STREAM_PORT
from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import Identity
from benchctl_instruments.links.address import Address, parse_address
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.simulated.clock import ScaledClock

_MOST_SHOWN = 60


class _Asked(NamedTuple):
    """How asking went: who it is, or what it failed with; whether anything at all came over the wire."""

    identity: Identity | None
    error: Exception | None
    heard: bytes
    is_modbus: bool


def findings_of_instrument(bench: Bench, role: Kind, address: Address) -> Iterator[Finding]:
    """Ask, and explain; whoever calls has the instrument to himself."""
    entry: InstrumentEntry = getattr(bench, role)
    try:
        asked = _ask(bench, role)
        if isinstance(asked.error, UsageError):
            raise asked.error
    except UsageError as err:
        do = f"correct [{role}] and its options in the bench; the docstring of {entry.model}'s driver names them"
        yield bad(role, "description", _line(err), do, unusable=True)
        return
    if asked.identity is not None:
        yield _identity_finding(role, entry, asked.identity)
    else:
        yield from _failed(bench, role, entry, address, asked)
    if role == "digitizer" and entry.model == "labjack_t7":
        yield from _stream_port(bench, address)


def _ask(bench: Bench, role: Kind) -> _Asked:
    """Open and identify, on a wire that is listened to; `UsageError` where no driver can be made."""
    entry: InstrumentEntry = getattr(bench, role)
    clock, log = ScaledClock(bench.time_factor), WireLog()
    if _takes_a_log(driver(role, entry.model, bench.chamber_profile if role == "chamber" else "")):
        listening = entry.model_copy(update={"options": {**entry.options, "wire_log": log}})
        made: Any = driver_at(bench.model_copy(update={role: listening}), role, clock, {})
    else:
        made = driver_at(bench, role, clock, {})
    identity, error = None, None
    try:
        with made:
            identity = made.identify()
    except Exception as err:  # whatever a driver of third parties may raise must not hide the other findings
        error = err
    heard = b"".join(entry.data for entry in log.last(64) if entry.direction == "received")
    return _Asked(identity=identity, error=error, heard=heard, is_modbus=isinstance(made, ModbusChamber))


def _takes_a_log(make: Any) -> bool:
    """Whether a driver notes what goes over its wire; ours that hand all keywords on do."""
    takes = inspect.signature(make).parameters
    hands_on = any(each.kind is each.VAR_KEYWORD for each in takes.values())
    return "wire_log" in takes or (hands_on and getattr(make, "__module__", "").startswith("benchctl_instruments."))


def _identity_finding(role: str, entry: InstrumentEntry, who: Identity) -> Finding:
    said = " ".join(word for word in (who.manufacturer, who.model, who.serial and f"serial {who.serial}") if word)
    says = f"answers as {entry.model} at {entry.address}: {said or 'it does not say who it is'}"
    if entry.serial and who.serial and entry.serial != who.serial:
        return bad(
            role,
            "identity",
            f"{says}; the bench expects serial {entry.serial}",
            f"correct the address, or serial, calibrated_until and certificate of [{role}]",
        )
    return ok(role, "identity", says)


def _failed(bench: Bench, role: Kind, entry: InstrumentEntry, address: Address, asked: _Asked) -> Iterator[Finding]:
    error = asked.error
    if not isinstance(error, BenchError):
        do = f"correct [{role}.options], or tell whoever wrote that driver" if entry.options else "tell who wrote it"
        yield bad(role, "driver", f"{entry.model} failed with {type(error).__name__}: {_line(error)}", do)
        return
    reached: Reached | None = None
    if address.scheme != "serial" and not asked.heard:
        reached = reach(address.host, address.port)
        finding = reach_finding(role, address, entry.model, reached)
        yield finding
        if finding.verdict == "bad":
            return
    heard = asked.heard or (reached.banner if reached is not None else b"")
    answers = bool(heard)
    if asked.is_modbus and not heard:
        asked_for = int(entry.options.get("unit_id", 1))
        units = list(units_that_answer(address, asked_for))
        if units and asked_for not in units:
            yield _other_unit(role, address, asked_for, units)
            return
        answers = bool(units)  # it was only slow
    others = who_else(bench, role, address, heard=answers, is_modbus=asked.is_modbus)
    if answers and not heard and not others:
        says = f"answers now, and did not before: {_first_clause(error)}"
        do = f"[{role}.options] timeout_s = 3.0 where it is slow; otherwise look for a loose contact, or a busy network"
        yield bad(role, "answer", says, do)
        return
    yield _not_this_model(role, entry, error, heard, others)


def _not_this_model(role: str, entry: InstrumentEntry, error: BenchError, heard: bytes, others: list[str]) -> Finding:
    if others:
        says = f"who answers is no {entry.model}, but {' or '.join(others)}: {_first_clause(error)}"
        return bad(role, "identity", says, f"correct {role}.address, or {role}.model; are two addresses interchanged?")
    if isinstance(error, InstrumentError):
        do = f"is it the {entry.model} that the bench says, and set up as its driver needs it?"
        return bad(role, "identity", _line(error), do)
    if heard:
        says = f"what comes is not what {entry.model} says ({_shown(heard)}): {_line(error)}"
        do = "compare speed, parity, protocol (Modbus RTU or TCP) and model with what is set at the instrument"
        return bad(role, "identity", says, do)
    says = f"silent: {_first_clause(error)}"
    do = (
        "the line is there, and nobody speaks: is the instrument on, is its remote interface switched on, are speed, "
        "unit and wiring (TX and RX, A and B) as they are set there, and does another program hold its only connection?"
    )
    return bad(role, "answer", says, do)


def _other_unit(role: Kind, address: Address, asked_for: int, units: list[int]) -> Finding:
    return bad(
        role,
        "unit",
        f"Modbus unit {asked_for} is silent; unit {' and '.join(map(str, units))} answers at {address}",
        f"[{role}.options] unit_id = {units[0]}, or set the controller's own address to {asked_for}",
    )


def _stream_port(bench: Bench, address: Address) -> Iterator[Finding]:
    text = bench.digitizer.stream_address
    try:
        stream = parse_address(text) if text else None
    except UsageError as err:
        yield bad("digitizer", "stream", str(err), "correct digitizer.stream_address", unusable=True)
        return
    stream = stream or Address(text="", scheme="tcp", host=address.host, port=STREAM_PORT)
    yield reach_finding("digitizer", stream, "labjack_t7", reach(stream.host, stream.port), what="stream")


def _first_clause(error: Exception) -> str:
    """What was tried and what came of it, without the driver's own advice."""
    return _line(error).partition("; ")[0]


def _line(error: Exception | None) -> str:
    return " ".join(str(error).split())


def _shown(data: bytes) -> str:
    return repr(data if len(data) <= _MOST_SHOWN else data[:_MOST_SHOWN] + b"...")
