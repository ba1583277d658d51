"""Find out which drivers recognise an unknown device, without changing anything on it.

Each driver declares how it recognises its instrument (`recognition`). The device is tested in this order, until a
driver recognises it:

1. Nothing is sent; frames that come unasked are recognised.
2. Lines of ASCII, each over a new connection: `*IDN?`, then the queries of the drivers; those that end in CR LF first,
   for every device takes them for complete. To a Modbus unit on a serial line these are frames with a wrong checksum,
   which it ignores.
3. Modbus, which is last because a line-based device would take its bytes for the beginning of a line. Only the function
   that reads registers is used, for identification constants first. A unit that answers neither of the first two
   requests receives no further ones.

If a serial address states no speed, each question is sent at the speed that its driver expects. Behind a TCP address
Modbus RTU is tried too, as behind a serial-to-Ethernet box.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NoReturn, TypeVar

from benchctl_instruments import entry_points
from benchctl_instruments.catalog import Kind, driver, models
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.lines import LineDialogue, Manners
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.links.tcp import LinkCutError, Reconnect
from benchctl_instruments.links.wirelog import WireEntry, WireLog
from benchctl_instruments.recognition import ANY_LINK, CERTAINTIES, ByFrames, ByLine, ByRegisters, Certainty

KINDS: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer", "gyro")
ASK_IDENTITY = "*IDN?"
SILENT_REQUESTS = 2
SETTLE_S = 0.05
"""Quiet time between two Modbus requests: what a unit has received before is then over."""
MOST_BYTES = 4096
ONCE = Reconnect(attempts=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inquiry:
    """One question and its answer, in words and as bytes; `address` is to which it was sent."""

    address: str
    question: str
    answer: str
    sent: bytes
    received: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Match:
    """A driver that recognises the device, the device in words, and its address and options in bench.toml."""

    kind: Kind
    model: str
    certainty: Certainty
    device: str
    address: str
    options: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Known:
    """A declaration of a driver."""

    kind: Kind
    model: str
    by: ByFrames | ByLine | ByRegisters


Way = TypeVar("Way", ByFrames, ByLine, ByRegisters)
Group = list[tuple[Known, Way]]


def known() -> list[Known]:
    """Return the declarations of all drivers; one of another package that cannot be loaded is reported and ignored."""
    found = []
    for kind in KINDS:
        for model in models(kind):
            try:
                declared = getattr(driver(kind, model), "recognition", ())
            except UsageError as err:
                entry_points.logger.warning("benchctl: warning: %s", err)
                continue
            found += [Known(kind, model, by) for by in declared]
    return found


class Probe:
    """Questions to the device at one address.

    Parameters
    ----------
    address
        The address, as in bench.toml.
    clock
        The clock that measures pauses.
    unit_id
        The number of the Modbus unit.
    timeout_s
        Timeout of a connection and of an answer; wall time.
    tell
        Called with every question and its answer.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        unit_id: int = 1,
        timeout_s: float = 1.0,
        tell: Callable[[Inquiry], None],
    ) -> None:
        self._address = parse_address(address)
        if self._address.scheme in ("visa", "daqmx"):
            raise UsageError(f"address {address!r}: what it names cannot be probed; state its model in bench.toml")
        self._clock = clock
        self._unit_id = unit_id
        self._timeout_s = timeout_s
        self._tell = tell

    def matches(self) -> list[Match]:
        """Ask, and return the drivers that recognise the device, best first.

        Raises `LinkError` if no connection can be made.
        """
        every = known()
        for look in (self._by_frames, self._by_lines, self._by_registers):
            if found := list(look(every)):
                return sorted(found, key=lambda match: CERTAINTIES.index(match.certainty))
        return []

    def _groups(self, every: Sequence[Known], way: type[Way]) -> dict[str, Group[Way]]:
        """Return the declarations of one way by the address to which they are sent, which states a speed."""
        groups: dict[str, Group[Way]] = {}
        for each in every:
            if isinstance(each.by, way) and self._address.scheme in getattr(each.by, "schemes", ANY_LINK):
                states_speed = self._address.scheme != "serial" or self._address.baud is not None
                address = str(self._address) if states_speed else f"{self._address}?baud={each.by.baud}"
                groups.setdefault(address, []).append((each, each.by))
        return groups

    def _by_frames(self, every: Sequence[Known]) -> Iterator[Match]:
        for address, group in self._groups(every, ByFrames).items():
            heard = self._listen(address)
            described = [(each, by, text) for each, by in group if (text := by.find(heard))]
            words = " or ".join(text for *_, text in described)
            words = words or (f"{len(heard)} bytes that are no known frame" if heard else "nothing")
            self._say(address, f"listen for {self._timeout_s:g} s", words, b"", heard)
            for each, by, text in described:
                yield _match(each, by.certainty, text, address)

    def _listen(self, address: str) -> bytes:
        link = byte_link(address, reconnect=ONCE)
        link.open(self._timeout_s)
        heard, until_s = b"", time.monotonic() + self._timeout_s
        try:
            while (left_s := until_s - time.monotonic()) > 0 and len(heard) < MOST_BYTES:
                heard += link.receive(MOST_BYTES, left_s)
        except LinkError:  # nothing more comes
            return heard
        finally:
            link.close()
        return heard

    def _by_lines(self, every: Sequence[Known]) -> Iterator[Match]:
        for address, group in self._groups(every, ByLine).items():
            identity = self._line(address, ByLine(query=ASK_IDENTITY, read=str)) or ""
            if named := [each for each, by in group if any(name in identity.upper() for name in by.names)]:
                yield from (_match(each, "certain", identity, address) for each in named)
                return
            for each, by in sorted(group, key=lambda one: (-len(one[1].sent_end), one[1].sent_end)):
                text = self._line(address, by)
                if text is not None:
                    yield _match(each, "likely", text, address)
                    return

    def _line(self, address: str, by: ByLine) -> str | None:
        """Ask for one line over a new connection; return what `by` reads in it, None if there is nothing to read."""
        log = WireLog(entry_bytes=MOST_BYTES)
        link = byte_link(address, reconnect=ONCE, wire_log=log)
        manners = Manners(
            sent_end=by.sent_end, answer_end=by.answer_end, encoding=by.encoding, timeout_s=self._timeout_s
        )
        dialogue = LineDialogue("device", link, manners=manners, clock=self._clock)
        found, words = None, "no complete line"
        try:
            dialogue.open()
            line = dialogue.tell(by.query)
            if line == by.query:
                words = "an echo: the device, or a wire between TX and RX, returns what is sent"
            else:
                words = f"{line!r}, not understood"
                found = by.read(line)
                words = found if found == line else f"{line!r}: {found}"
        except LinkCutError:
            words = "the other side closed the connection"
        except (InstrumentError, LinkError):  # `words` states it
            pass
        finally:
            dialogue.close()
        entries = log.last(64)
        received = _bytes_of(entries, "received")
        self._say(address, by.query, words if received else "nothing", _bytes_of(entries, "sent"), received)
        return found

    def _by_registers(self, every: Sequence[Known]) -> Iterator[Match]:
        groups = self._groups(every, ByRegisters)
        if self._address.scheme == "tcp":
            behind_a_box = str(self._address).replace("tcp://", "socket://", 1)
            (direct,) = groups.values()
            groups[behind_a_box] = [(each, by) for each, by in direct if "socket" in by.schemes]
        for address, group in groups.items():
            link = _ReadOnlyLink(
                address, unit_id=self._unit_id, timeout_s=self._timeout_s, clock=self._clock, say=self._say
            )
            try:
                link.open()
            except LinkError:
                self._say(address, "connect", "no connection", b"", b"")
                continue
            try:
                yield from self._of_unit(link, address, group)
            finally:
                link.close()
            if link.answers:
                return

    def _of_unit(self, link: _ReadOnlyLink, address: str, group: Group[ByRegisters]) -> Iterator[Match]:
        options = {} if self._unit_id == 1 else {"unit_id": self._unit_id}
        for each, by in sorted(group, key=lambda one: CERTAINTIES.index(one[1].certainty)):
            link.pause(max(by.pause_s, SETTLE_S))
            try:
                text = by.read(link, self._clock)
            except (InstrumentError, LinkError):  # the link has reported it
                continue
            yield _match(each, by.certainty, text, address, options)
            if by.certainty == "certain":
                return

    def _say(self, address: str, question: str, answer: str, sent: bytes, received: bytes) -> None:
        self._tell(Inquiry(address=address, question=question, answer=answer, sent=sent, received=received))


class _ReadOnlyLink(ModbusLink):
    """A link that reads each register once, reports each reading, and refuses to write."""

    def __init__(
        self,
        address: str,
        *,
        unit_id: int,
        timeout_s: float,
        clock: Clock,
        say: Callable[[str, str, str, bytes, bytes], None],
    ) -> None:
        self._entries: list[WireEntry] = []
        log = WireLog(entry_bytes=MOST_BYTES, sink=self._entries.append)
        once = Retry(attempts=1, wait_s=SETTLE_S)
        super().__init__(address, unit_id=unit_id, timeout_s=timeout_s, retry=once, clock=clock, wire_log=log)
        self._say = say
        self._read: dict[tuple[int, int], list[int] | InstrumentError | LinkError] = {}
        self._silent = 0
        self.answers = False
        """Whether the unit has answered a request, be it with a refusal."""

    def pause(self, pause_s: float) -> None:
        """Set the quiet time between two exchanges."""
        self._pause_s = pause_s

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return registers as `ModbusLink`; the error of an earlier request is raised again."""
        if not self.answers and self._silent >= SILENT_REQUESTS:
            raise LinkError(f"{self.who}: silent; check unit number and speed")
        if (address, count) not in self._read:
            self._read[address, count] = self._asked(address, count)
        found = self._read[address, count]
        if isinstance(found, list):
            return found
        raise found

    def write(self, *_: object, **__: object) -> NoReturn:
        """Refuse: a probe changes nothing."""
        raise UsageError(f"{self.who}: a probe only reads, and its driver's recognition writes; correct the driver")

    def _asked(self, address: int, count: int) -> list[int] | InstrumentError | LinkError:
        self._entries.clear()
        registers = f"register {address}" if count == 1 else f"registers {address} to {address + count - 1}"
        found: list[int] | InstrumentError | LinkError
        try:
            found = super().read(address, count)
            words = ", ".join(map(str, found))
            self.answers = True
        except InstrumentError as err:
            found, words = err, self._clause(err, registers)
            self.answers = True
        except LinkError as err:
            found, words = err, self._clause(err, registers)
            self._silent += 1
        question = f"Modbus unit {self._unit_id}: {registers}"
        sent, received = _bytes_of(self._entries, "sent"), _bytes_of(self._entries, "received")
        self._say(str(self.address), question, words if received else "nothing", sent, received)
        return found

    def _clause(self, err: Exception, registers: str) -> str:
        """Return what became of a request, without the link's advice."""
        return str(err).removeprefix(f"{self.who}: reading {registers} ").removeprefix("was ").partition("; ")[0]


def _match(
    each: Known, certainty: Certainty, device: str, address: str, options: dict[str, int] | None = None
) -> Match:
    return Match(
        kind=each.kind, model=each.model, certainty=certainty, device=device, address=address, options=options or {}
    )


def _bytes_of(entries: Sequence[WireEntry], direction: str) -> bytes:
    return b"".join(entry.data for entry in entries if entry.direction == direction)
