"""Which Modbus units answer at an address: asked for a register each, which changes nothing."""

from __future__ import annotations

from collections.abc import Iterator

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.links.address import Address
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.protocols.modbus import exception_words

_UNITS = range(1, 11)
_ANSWER_S = 0.25
_ONCE = Retry(attempts=1, wait_s=0.05)
_GATEWAYS_OWN = tuple(exception_words(code) for code in (0x0A, 0x0B))


def units_that_answer(address: Address, expected: int) -> Iterator[int]:
    """Which of the first ten, and of the expected one, answer: with a register, or a refusal of their own.

    A few seconds; the expected one is the last, so that one that was only away has time to come back.
    """
    for unit in (*(unit for unit in _UNITS if unit != expected), expected):
        if _answers(address, unit):
            yield unit


def _answers(address: Address, unit: int) -> bool:
    link = ModbusLink(str(address), unit_id=unit, timeout_s=_ANSWER_S, retry=_ONCE)
    try:
        link.open()
        link.read(0)
    except InstrumentError as err:
        return not any(words in str(err) for words in _GATEWAYS_OWN)  # a gateway that has no such unit behind it
    except LinkError:
        return False
    finally:
        link.close()
    return True
