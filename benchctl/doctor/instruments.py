"""Identify one instrument with its own driver; if that fails, find the cause as far as the line shows it.

Other models are tried only if this changes nothing on the instrument: with our own drivers of rate tables and chambers,
which only send queries when they are opened, and for a LabJack by reading two registers. Digital gyros are not tried,
since identifying one requires stopping its stream.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from benchctl.bench import Bench
from benchctl.bench_instruments import InstrumentEntry
from benchctl.campaign.opened import driver_at
from benchctl.doctor.finding import Finding, bad, ok
from benchctl.doctor.reach import Reached, reach, reach_finding
from benchctl_instruments.catalog import Kind, driver, our_models
from benchctl_instruments.chambers.modbus_chamber import ModbusChamber
from benchctl_instruments.digitizers import t7_registers as t7
from benchctl_instruments.digitizers.labjack_t7 import STREAM_PORT
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Identity
from benchctl_instruments.links.address import Address, parse_address
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.modbus import exception_words
from benchctl_instruments.simulated.clock import ScaledClock

_MOST_SHOWN = 60
_LONGEST_S = 12.0
_MODEL_ANSWER_S = 0.5
_KINDS: tuple[Kind, ...] = ("rate_table", "chamber")
_OVER_MODBUS_TCP = ("watlow_f4t",)
_UNITS = range(1, 11)
_UNIT_ANSWER_S = 0.25
_GATEWAYS_OWN = tuple(exception_words(code) for code in (0x0A, 0x0B))


class _Attempt(NamedTuple):
    """The result: the identity or the error, and the bytes received over the wire."""

    identity: Identity | None
    error: Exception | None
    heard: bytes
    is_modbus: bool


def findings_of_instrument(bench: Bench, role: Kind, address: Address) -> Iterator[Finding]:
    """Identify an instrument and explain an error; the caller holds the lock of its line."""
    entry: InstrumentEntry = getattr(bench, role)
    try:
        attempt = _identify(bench, role)
        if isinstance(attempt.error, UsageError):
            raise attempt.error
    except UsageError as err:
        do = f"correct [{role}] and its options in the bench; the docstring of {entry.model}'s driver names them"
        yield bad(role, "description", _line(err), do, unusable=True)
        return
    if attempt.identity is not None:
        yield _identity_finding(role, entry, attempt.identity)
    else:
        yield from _failed(bench, role, entry, address, attempt)
    if role == "digitizer" and entry.model == "labjack_t7":
        yield from _stream_port(bench, address)


def _identify(bench: Bench, role: Kind) -> _Attempt:
    """Open and identify an instrument with its wire logged; raise `UsageError` if its driver cannot be created."""
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
    except Exception as err:  # an exception of a third party's driver must not hide the other findings
        error = err
    heard = b"".join(entry.data for entry in log.last(64) if entry.direction == "received")
    return _Attempt(identity=identity, error=error, heard=heard, is_modbus=isinstance(made, ModbusChamber))


def _takes_a_log(make: Any) -> bool:
    """Return whether a driver can log its wire; our drivers that forward all keyword arguments can."""
    takes = inspect.signature(make).parameters
    hands_on = any(each.kind is each.VAR_KEYWORD for each in takes.values())
    return "wire_log" in takes or (hands_on and getattr(make, "__module__", "").startswith("benchctl_instruments."))


def _identity_finding(role: str, entry: InstrumentEntry, who: Identity) -> Finding:
    identity = " ".join(word for word in (who.manufacturer, who.model, who.serial and f"serial {who.serial}") if word)
    message = f"answers as {entry.model} at {entry.address}: {identity or 'without an identity'}"
    if entry.serial and who.serial and entry.serial != who.serial:
        return bad(
            role,
            "identity",
            f"{message}; the bench expects serial {entry.serial}",
            f"correct the address, or serial, calibrated_until and certificate of [{role}]",
        )
    return ok(role, "identity", message)


def _failed(bench: Bench, role: Kind, entry: InstrumentEntry, address: Address, attempt: _Attempt) -> Iterator[Finding]:
    error = attempt.error
    if not isinstance(error, BenchError):
        do = (
            f"correct [{role}.options], or report it to the author of that driver"
            if entry.options
            else "report it to its author"
        )
        yield bad(role, "driver", f"{entry.model} failed with {type(error).__name__}: {_line(error)}", do)
        return
    if address.scheme == "visa" and not attempt.heard:
        do = "check its power, its address on the bus, and that the VISA of this computer serves that interface"
        yield bad(role, "answer", f"silent: {_first_clause(error)}", f"{do} (pyvisa-info shows it)")
        return
    if address.scheme == "daqmx":
        do = "check the device's name and power as NI-DAQmx shows them (NI MAX, or nilsdev on Linux)"
        yield bad(role, "answer", _first_clause(error), do)
        return
    reached: Reached | None = None
    if address.scheme in ("tcp", "socket") and not attempt.heard:
        reached = reach(address.host, address.port)
        finding = reach_finding(role, address, entry.model, reached)
        yield finding
        if finding.verdict == "bad":
            return
    heard = attempt.heard or (reached.banner if reached is not None else b"")
    answers = bool(heard)
    if attempt.is_modbus and not heard:
        unit = int(entry.options.get("unit_id", 1))
        units = list(units_that_answer(address, unit))
        if units and unit not in units:
            yield _other_unit(role, address, unit, units)
            return
        answers = bool(units)  # it was only slow
    others = who_else(bench, role, address, heard=answers, is_modbus=attempt.is_modbus)
    if answers and not heard and not others:
        message = f"answers now, but did not before: {_first_clause(error)}"
        do = f"[{role}.options] timeout_s = 3.0 where it is slow; otherwise look for a loose contact, or a busy network"
        yield bad(role, "answer", message, do)
        return
    yield _not_this_model(role, entry, error, heard, others)


def _not_this_model(role: str, entry: InstrumentEntry, error: BenchError, heard: bytes, others: list[str]) -> Finding:
    if others:
        message = f"the device that answers is not {entry.model} but {' or '.join(others)}: {_first_clause(error)}"
        return bad(
            role, "identity", message, f"correct {role}.address, or {role}.model; are two addresses interchanged?"
        )
    if isinstance(error, InstrumentError):
        do = f"check that it is the {entry.model} that the bench names, set up as its driver needs it"
        return bad(role, "identity", _line(error), do)
    if heard:
        message = f"the received bytes are not of the protocol of {entry.model} ({_shown(heard)}): {_line(error)}"
        do = (
            "compare speed, parity, protocol (Modbus RTU or TCP) and model with what is set at the instrument;"
            f" benchctl instrument probe {entry.address} shows what it answers"
        )
        return bad(role, "identity", message, do)
    message = f"silent: {_first_clause(error)}"
    do = (
        "the line works, the instrument is silent: check its power, its remote interface, speed, unit and wiring "
        "(TX and RX, A and B), and whether another program holds its only connection"
    )
    return bad(role, "answer", message, do)


def _other_unit(role: Kind, address: Address, unit: int, units: list[int]) -> Finding:
    return bad(
        role,
        "unit",
        f"Modbus unit {unit} is silent; unit {' and '.join(map(str, units))} answers at {address}",
        f"[{role}.options] unit_id = {units[0]}, or set the controller's own address to {unit}",
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
    """Return the action and its result from an error message, without the driver's advice."""
    return _line(error).partition("; ")[0]


def _line(error: Exception | None) -> str:
    return " ".join(str(error).split())


def _shown(data: bytes) -> str:
    return repr(data if len(data) <= _MOST_SHOWN else data[:_MOST_SHOWN] + b"...")


def who_else(bench: Bench, role: Kind, address: Address, *, heard: bool, is_modbus: bool) -> list[str]:
    """Return the models that answer at an address.

    If no byte was received (`heard` is false), only models of the same kind and those with Modbus over TCP are tried.
    After a silent Modbus unit (`is_modbus`), no other Modbus model is tried, since it would send the same requests.
    """
    found = list(_labjack(address)) if address.scheme == "tcp" and role != "digitizer" else []
    until_s = time.monotonic() + _LONGEST_S
    clock = ScaledClock(bench.time_factor)
    for kind, candidates in _candidates(bench, role, address, heard):
        if found:  # a model of the expected kind answers: no other kind is tried
            break
        for model in candidates:
            make = driver(kind, model)
            if time.monotonic() > until_s or (is_modbus and not heard and _speaks_modbus(make)):
                continue
            if _answers_as(make, address, clock):
                found.append(f"one that answers as {model} does")
    return found


def _candidates(bench: Bench, role: Kind, address: Address, heard: bool) -> Iterator[tuple[Kind, list[str]]]:
    """Yield the kinds and their models to try, the expected kind first."""
    if role == "gyro":
        return
    for kind in sorted(_KINDS, key=lambda kind: kind != role):
        if kind == role:
            yield kind, [model for model in our_models(kind) if model != getattr(bench, role).model]
        elif heard:
            yield kind, list(our_models(kind))
        elif address.scheme == "tcp":
            yield kind, [model for model in our_models(kind) if model in _OVER_MODBUS_TCP]


def _speaks_modbus(make: Any) -> bool:
    return isinstance(make, type) and issubclass(make, ModbusChamber)


def _answers_as(make: Any, address: Address, clock: ScaledClock) -> bool:
    if not getattr(make, "__module__", "").startswith("benchctl_instruments."):  # the effect of opening is unknown
        return False
    takes = inspect.signature(make).parameters
    quick: dict[str, Any] = {"timeout_s": _MODEL_ANSWER_S}
    if "retry" in takes or any(each.kind is each.VAR_KEYWORD for each in takes.values()):
        quick["retry"] = Retry(attempts=1)
    try:
        with make(str(address), clock=clock, **quick) as instrument:
            instrument.identify()
    except (BenchError, AttributeError, TypeError, ValueError):  # last three: it needs another kind of address
        return False
    return True


def _labjack(address: Address) -> Iterator[str]:
    link = ModbusLink(str(address), timeout_s=_MODEL_ANSWER_S, retry=Retry(attempts=1))
    registers = t7.T7Registers(link)
    try:
        link.open()
        if int(registers.read(t7.TEST)) == t7.TEST_VALUE:
            product, number = registers.read(t7.PRODUCT_ID), int(registers.read(t7.SERIAL_NUMBER))
            yield f"a LabJack T{product:g}, serial {number}"
    except (BenchError, ValueError):
        return
    finally:
        link.close()


def units_that_answer(address: Address, expected: int) -> Iterator[int]:
    """Yield the Modbus units, out of 1 to 10 and the expected one, that answer a read with a value or an exception.

    This takes a few seconds. The expected unit is tried last, to give a unit that was briefly absent time to return.
    """
    for unit in (*(unit for unit in _UNITS if unit != expected), expected):
        if _unit_answers(address, unit):
            yield unit


def _unit_answers(address: Address, unit: int) -> bool:
    link = ModbusLink(str(address), unit_id=unit, timeout_s=_UNIT_ANSWER_S, retry=Retry(attempts=1, wait_s=0.05))
    try:
        link.open()
        link.read(0)
    except InstrumentError as err:
        return not any(words in str(err) for words in _GATEWAYS_OWN)  # a gateway without such a unit
    except LinkError:
        return False
    finally:
        link.close()
    return True
