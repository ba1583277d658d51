"""A chamber with a Watlow F4T controller over Modbus TCP, or RTU.

Not tried on hardware. Register numbers and codes: EspecNorthAmerica/ChamberConnectLibrary (F4T); units of the bus:
Watlow F4T manual, page 225. Numbers are IEEE 754 singles in two registers, low word first as delivered; states are
codes common to all Watlow controllers.

Fault handling: link faults as in `ModbusLink`; a write states a value and not a change, and is repeated, except the
press of a key, where a second press may undo the first. In addition:

| fault                                       | handling                                                            |
|---------------------------------------------|---------------------------------------------------------------------|
| an exception                                | `InstrumentError`, never repeated                                   |
| the answer to the press of a key is lost    | `LinkError`: the chamber's state is then unknown                    |
| words in the other order, half of a float   | `InstrumentError`; the request is repeated                          |
| a sensor over range                         | its number is returned: it exceeds the bench's limits, which stop   |
| the bus is set to °F, as delivered          | `InstrumentError` from `open`                                       |
| a set point or switch that does not arrive  | `InstrumentError` after 2 s of reading back                         |
| a profile runs, is paused or waits          | `InstrumentError` from `start`                                      |
| an alarm                                    | included in every reading until it is over                          |
| air that is stuck, or stalls short          | not detectable from one reading; a soak that does not end shows it  |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

from benchctl_instruments.chambers.modbus_chamber import ModbusChamber, Quantity, QuantityTable
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.modbus import WordOrder
from benchctl_instruments.recognition import ByRegisters

AUTO, ON, OFF, NONE, STARTUP, INACTIVE, UP, DOWN = 10, 63, 62, 61, 88, 12, 1456, 1457
CELSIUS = 15
ALARM_SILENT = (STARTUP, NONE, INACTIVE)
CODE_WORDS = {10: "auto", 28: "error", 30: "°F", 32: "fail", 54: "manual", 61: "none", 62: "off", 63: "on"}
PROFILE_WORDS = {146: "is paused", 149: "runs", 1783: "waits for its start by the clock"}

LOW_LIMIT = Quantity(name="set point low limit", address=2774, kind="f32", unit="°C", writable=True)
HIGH_LIMIT = Quantity(name="set point high limit", address=2776, kind="f32", unit="°C", writable=True)
SETPOINT = Quantity(name="set point", address=2782, kind="f32", unit="°C", writable=True)
POWER = Quantity(name="power", address=2808, kind="f32", unit="%")
CONTROL_MODE = Quantity(name="control mode", address=2814, kind="code")
AIR = Quantity(name="process value", address=2820, kind="f32", unit="°C")
LOOPS, LOOP_STEP = 4, 160

PROFILE_STATE = Quantity(name="profile state", address=16568, kind="code")
UNIT = Quantity(name="unit of the Ethernet bus", address=6730, kind="code")
SERIAL_UNIT = Quantity(name="unit of the serial bus", address=14080, kind="code")
ALARMS = tuple(
    Quantity(name=f"alarm {number}", address=1356 + 100 * (number - 1), kind="code") for number in range(1, 15)
)
FEWEST_ALARMS = 6
ALARMS_OF = {"B": 8, "C": 14, "E": 8, "F": 14}
"""Number of alarms, by the part number's seventh character; for any other one: `FEWEST_ALARMS`."""
EVENTS = tuple(
    Quantity(name=f"event {number}", address=address, kind="code", writable=True)
    for number, address in enumerate((16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828), start=1)
)
KEYS = tuple(Quantity(name=f"key {number}", address=6844 + 20 * (number - 1), kind="code") for number in range(1, 5))
KEY_PRESSES = tuple(
    Quantity(name=f"press of key {number}", address=6850 + 20 * (number - 1), kind="code", writable=True)
    for number in range(1, 5)
)
PART_NUMBER_ADDRESS, PART_NUMBER_LENGTH = 16, 15


SWITCHES = {"event": len(EVENTS), "toggle_key": len(KEYS), "momentary_key": len(KEYS), "nothing": 1}


def part_number_of(link: ModbusLink) -> str:
    """Return the part number; raises `InstrumentError` if its registers hold none."""
    characters = link.read(PART_NUMBER_ADDRESS, PART_NUMBER_LENGTH)
    part_number = "".join(chr(character) for character in characters).strip(" \0")
    if not (part_number.isascii() and part_number.isprintable() and part_number):
        raise InstrumentError(
            f"{link.who}: the {PART_NUMBER_LENGTH} registers from {PART_NUMBER_ADDRESS} on hold"
            f" {part_number!r} instead of a part number; check that it is a Watlow F4T"
        )
    return part_number


def _recognised(link: ModbusLink, _: Clock) -> str:
    """Describe an F4T by its part number; raises `InstrumentError` for another device."""
    if not (part_number := part_number_of(link)).startswith("F4T"):
        raise InstrumentError(f"expected a part number that begins with F4T, got {part_number!r}")
    return f"Watlow {part_number}"


class WatlowF4T(ModbusChamber):
    """Driver of a chamber with a Watlow F4T. Not tried on hardware; its bus must be set to degrees Celsius.

    Parameters
    ----------
    address
        `tcp://HOST:502`, or a serial line.
    clock
        The clock used for waiting.
    unit_id
        Modbus address of the controller.
    loop
        The control loop of the air, 1 to 4.
    word_order
        Word order of the singles; as delivered "low_first".
    on_by, on_number
        What the chamber's manufacturer wired to conditioning on/off, and the number of that event (1 to 8) or key
        (1 to 4). "event": an output that is on or off (TestEquity: event 1). "toggle_key": a function key with a state,
        which 1457 (down) switches on and 1456 (up) off. "momentary_key": a function key without a state, each press of
        which starts or stops the chamber (ESPEC: key 1). "nothing": the chamber conditions while it has power, and
        `start` and `stop` do not change that.
    running_output
        Module and input/output number of the "chamber running" output (ESPEC: [1, 1]), which then confirms on and off;
        required for a momentary key.
    pause_s, timeout_s, retry, wire_log
        See `ModbusLink`; on a serial line the controller requires a pause of 0.03 s.
    """

    recognition = (ByRegisters(read=_recognised, certainty="certain"),)

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        unit_id: int = 1,
        loop: int = 1,
        word_order: WordOrder = "low_first",
        on_by: Literal["event", "toggle_key", "momentary_key", "nothing"] = "toggle_key",
        on_number: int = 1,
        running_output: Sequence[int] | None = None,
        pause_s: float = 0.0,
        timeout_s: float = 1.0,
        retry: Retry | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if not 1 <= loop <= LOOPS:
            raise UsageError(f"loop = {loop}: expected a loop of a Watlow F4T, 1 to {LOOPS}")
        if word_order not in get_args(WordOrder):
            raise UsageError(f"word_order = {word_order!r}: expected {' or '.join(get_args(WordOrder))}")
        if on_by not in SWITCHES or not 1 <= on_number <= SWITCHES[on_by]:
            known = ", ".join(f"{switch} (1 to {most})" for switch, most in SWITCHES.items())
            raise UsageError(f"on_by = {on_by!r} with on_number = {on_number}: expected {known} of a Watlow F4T")
        if running_output is None and on_by == "momentary_key":
            raise UsageError("a momentary key needs running_output: without it nothing shows whether the chamber runs")
        self._on_by, self._on_number = on_by, on_number
        self._running = None if running_output is None else _running_output(*running_output)
        link = ModbusLink(
            address,
            unit_id=unit_id,
            name="Watlow F4T",
            timeout_s=timeout_s,
            retry=retry,
            pause_s=pause_s,
            clock=clock,
            wire_log=wire_log,
        )
        super().__init__(
            link,
            QuantityTable(link, clock=clock, word_order=word_order),
            setpoint=_in_loop(SETPOINT, loop),
            low_limit=_in_loop(LOW_LIMIT, loop),
            high_limit=_in_loop(HIGH_LIMIT, loop),
        )
        self._air = _in_loop(AIR, loop)
        self._power = _in_loop(POWER, loop)
        self._mode = _in_loop(CONTROL_MODE, loop)
        self._alarms = ALARMS[:FEWEST_ALARMS]

    def identify(self) -> Identity:
        """Return the controller's identity with its part number."""
        return Identity(manufacturer="Watlow", model=part_number_of(self._link))

    def read(self) -> ChamberReading:
        """Return air temperature, set point, power and all alarms."""
        values = self._table.read_together((self._air, self._setpoint, self._power, *self._alarms))
        return ChamberReading(
            temperature_c=values[AIR.name],
            setpoint_c=values[SETPOINT.name],
            power_percent=values[POWER.name],
            alarms=tuple(
                f"{alarm.name} active, {_in_words(code)}"
                for alarm in self._alarms
                if (code := int(values[alarm.name])) not in ALARM_SILENT
            ),
        )

    def _check_controller(self) -> None:
        part_number = self.identify().model
        self._alarms = ALARMS[: ALARMS_OF.get(part_number[6:7], FEWEST_ALARMS)]
        unit = UNIT if self._link.address.scheme == "tcp" else SERIAL_UNIT
        if (code := self._table.read_code(unit)) != CELSIUS:
            raise InstrumentError(
                f"{self._link.who}: {unit.name} (register {unit.address}) is {_in_words(code)}, expected"
                f" code {CELSIUS} (°C); set Display Units to °C under Menu, Settings, Network, Modbus on its panel"
            )
        self._table.read(self._air)

    def _switch(self, *, on: bool) -> None:
        if on and (doing := PROFILE_WORDS.get(self._table.read_code(PROFILE_STATE))):
            raise InstrumentError(
                f"{self._link.who}: a profile {doing} and would not keep our set point; end it on its panel"
            )
        wanted = ON if on else OFF
        if self._on_by == "event":
            self._table.put(EVENTS[self._on_number - 1], wanted)
        elif self._on_by != "nothing":
            self._press_key(wanted)
        if self._running is not None:
            self._table.confirm(self._running, wanted)
        if on and (mode := self._table.read_code(self._mode)) != AUTO:
            raise InstrumentError(
                f"{self._link.who}: the control mode is {_in_words(mode)},"
                f" expected {_in_words(AUTO)}; set it on its panel"
            )

    def _press_key(self, wanted: int) -> None:
        """Press the key once if the chamber is not in the wanted state, since a second press may undo the first."""
        momentary = self._on_by == "momentary_key"
        shows = self._running if momentary and self._running is not None else KEYS[self._on_number - 1]
        if self._table.read_code(shows) != wanted:
            press = DOWN if momentary or wanted == ON else UP
            self._table.write(KEY_PRESSES[self._on_number - 1], press, once=True)
            try:
                self._table.confirm(shows, wanted)
            except InstrumentError as err:
                other = (
                    "" if momentary else "; if it is a momentary key, give on_by = 'momentary_key' and running_output"
                )
                raise InstrumentError(f"{err}; the key was pressed, look whether the chamber runs{other}") from err


def _in_loop(quantity: Quantity, loop: int) -> Quantity:
    return replace(quantity, address=quantity.address + LOOP_STEP * (loop - 1))


def _running_output(module: int, io: int) -> Quantity:
    """Return the output that is on while the chamber runs; a missing module or output gives exception 4."""
    address = 33718 + 240 * (module - 1) + 40 * (io - 1)
    return Quantity(name=f"chamber running, output {io} of module {module}", address=address, kind="code")


def _in_words(code: int) -> str:
    return f"code {code} ({CODE_WORDS[code]})" if code in CODE_WORDS else f"code {code}"


Driver = WatlowF4T
