"""Who answers in the place of an instrument: the other models asked who they are, as long as asking changes nothing.

Only our own drivers of rate tables and chambers are tried, since opening them does nothing but ask, and a LabJack is
known by two registers. Digital gyros are left out: to ask one, its stream has to be stopped.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Iterator
from typing import Any

from benchctl.bench import Bench
from benchctl_instruments.catalog import Kind, driver, our_models
from benchctl_instruments.chambers.modbus_chamber import ModbusChamber
from benchctl_instruments.digitizers import t7_registers as t7
from benchctl_instruments.errors import BenchError
from benchctl_instruments.links.address import Address
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.simulated.clock import ScaledClock

_LONGEST_S = 12.0
_ANSWER_S = 0.5
_KINDS: tuple[Kind, ...] = ("rate_table", "chamber")
_OVER_MODBUS_TCP = ("watlow_f4t",)


def who_else(bench: Bench, role: Kind, address: Address, *, heard: bool, is_modbus: bool) -> list[str]:
    """The models that answer at an address, in words.

    Where nothing was heard only those of the same kind are tried, and what speaks Modbus over TCP; and of a Modbus unit
    that was silent no further one that would ask it in the same way. `is_modbus`: so it was asked.
    """
    found = list(_labjack(address)) if address.scheme == "tcp" and role != "digitizer" else []
    until_s = time.monotonic() + _LONGEST_S
    clock = ScaledClock(bench.time_factor)
    for kind, candidates in _candidates(bench, role, address, heard):
        if found:  # what answers as one of the kind that was meant is that
            break
        for model in candidates:
            make = driver(kind, model)
            if time.monotonic() > until_s or (is_modbus and not heard and _speaks_modbus(make)):
                continue
            if _answers_as(make, address, clock):
                found.append(f"one that answers as {model} does")
    return found


def _candidates(bench: Bench, role: Kind, address: Address, heard: bool) -> Iterator[tuple[Kind, list[str]]]:
    """Kinds and their models that might be there, the kind that was meant first."""
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
    if not getattr(make, "__module__", "").startswith("benchctl_instruments."):  # what opening does there is not known
        return False
    takes = inspect.signature(make).parameters
    quick: dict[str, Any] = {"timeout_s": _ANSWER_S}
    if "retry" in takes or any(each.kind is each.VAR_KEYWORD for each in takes.values()):
        quick["retry"] = Retry(attempts=1)
    try:
        with make(str(address), clock=clock, **quick) as instrument:
            instrument.identify()
    except (BenchError, AttributeError, TypeError, ValueError):  # the latter: it takes another kind of address
        return False
    return True


def _labjack(address: Address) -> Iterator[str]:
    link = ModbusLink(str(address), timeout_s=_ANSWER_S, retry=Retry(attempts=1))
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
