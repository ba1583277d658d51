"""A chamber with a Watlow Series F4 controller (F4S, F4D) over Modbus RTU.

Not tried on hardware. Register numbers and codes: EspecNorthAmerica/ChamberConnectLibrary (F4), and for 101, 102 and
106 the F4P user manual, Watlow 2003, chapter 9. Numbers are signed 16-bit with an implied decimal point, whose position
the controller stores in register 606.

Fault handling: link faults as in `ModbusLink`; every written register takes a value and not a change, so a repeated
write is harmless. In addition:

| fault                                       | handling                                                            |
|---------------------------------------------|---------------------------------------------------------------------|
| an exception                                | `InstrumentError`, never repeated                                   |
| the sensor is over or under range           | `InstrumentError` from `read`: there is no valid temperature        |
| a set point or switch that does not arrive  | `InstrumentError` after 2 s of reading back                         |
| an alarm                                    | included in every reading until it is cleared at the controller     |
| air that is stuck, or stalls short          | not detectable from one reading; a soak that does not end shows it  |
"""

from __future__ import annotations

from benchctl_instruments.chambers.modbus_chamber import ModbusChamber, Quantity, QuantityTable
from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.modbus import ModbusLink, Retry
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.recognition import ByRegisters

AIR = Quantity(name="process value 1", address=100, kind="signed", unit="°C")
INPUT_ERROR = Quantity(name="input error 1", address=101, kind="code")
ALARMS = (
    Quantity(name="alarm 1", address=102, kind="code"),
    Quantity(name="alarm 2", address=106, kind="code"),
)
HEATING = Quantity(name="output 1A", address=103, kind="signed", unit="%", decimals=2)
COOLING = Quantity(name="output 1B", address=107, kind="signed", unit="%", decimals=2)
MODE = Quantity(name="operating mode", address=200, kind="code")
SETPOINT = Quantity(name="set point 1", address=300, kind="signed", unit="°C", writable=True)
SETPOINT_2 = Quantity(name="set point 2", address=319, kind="signed")
LOW_LIMIT = Quantity(name="set point low limit", address=602, kind="signed", unit="°C", writable=True)
HIGH_LIMIT = Quantity(name="set point high limit", address=603, kind="signed", unit="°C", writable=True)
DECIMALS = Quantity(name="decimal point of input 1", address=606, kind="code")
TEMPERATURE_UNIT = Quantity(name="temperature unit", address=901, kind="code")
EVENTS = tuple(
    Quantity(name=f"event {number}", address=2000 + 10 * (number - 1), kind="code", writable=True)
    for number in range(1, 9)
)

READING = (AIR, INPUT_ERROR, *ALARMS, HEATING, COOLING, SETPOINT)
INPUT_ERROR_WORDS = {1: "converter underflow", 2: "under range", 3: "over range"}
ALARM_WORDS = {1: "high", 2: "low"}
MODE_WORDS = {2: "runs a profile", 3: "holds a profile"}
CELSIUS = 1
TEMPERATURE_UNITS = {0: "°F", CELSIUS: "°C"}
PAUSE_S = 0.03
MOST_DECIMALS = 3


def _recognised(link: ModbusLink, clock: Clock) -> str:
    """Describe an F4 by its decimal point, unit and limits; raises `InstrumentError` for another device."""
    table = QuantityTable(link, clock=clock)
    decimals, unit = table.read_code(DECIMALS), table.read_code(TEMPERATURE_UNIT)
    low, high = table.read_together((LOW_LIMIT, HIGH_LIMIT)).values()
    if decimals > MOST_DECIMALS or unit not in TEMPERATURE_UNITS or low >= high:
        raise InstrumentError(f"expected decimals, a unit and limits, got {decimals}, {unit}, {low:g} to {high:g}")
    table.decimals = decimals
    celsius = "" if unit == CELSIUS else "; it must be set to °C"
    return f"Watlow F4; air {table.read(AIR):g} {TEMPERATURE_UNITS[unit]}{celsius}"


class WatlowF4(ModbusChamber):
    """Driver of a chamber with a Watlow F4. Not tried on hardware.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=19200` (or 9600, as set on the controller), or `socket://HOST:PORT`.
    clock
        The clock used for waiting.
    unit_id
        Modbus address of the controller.
    on_event
        The event (digital output) that the chamber's manufacturer wired to conditioning on/off. None: nothing is wired,
        the chamber conditions while it has power, and `start` and `stop` do not change that.
    pause_s
        Quiet time on the line between two exchanges; the controller requires 30 ms.
    timeout_s, retry, wire_log
        See `ModbusLink`.
    """

    recognition = (ByRegisters(read=_recognised, certainty="likely", pause_s=PAUSE_S),)

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        unit_id: int = 1,
        on_event: int | None = 1,
        pause_s: float = PAUSE_S,
        timeout_s: float = 1.0,
        retry: Retry | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if on_event is not None and not 1 <= on_event <= len(EVENTS):
            raise UsageError(f"on_event = {on_event}: expected an event of a Watlow F4, 1 to {len(EVENTS)}")
        link = ModbusLink(
            address,
            unit_id=unit_id,
            name="Watlow F4",
            timeout_s=timeout_s,
            retry=retry,
            pause_s=pause_s,
            clock=clock,
            wire_log=wire_log,
        )
        table = QuantityTable(link, clock=clock)
        super().__init__(link, table, setpoint=SETPOINT, low_limit=LOW_LIMIT, high_limit=HIGH_LIMIT)
        self._on_event = None if on_event is None else EVENTS[on_event - 1]

    def identify(self) -> Identity:
        """Return F4S or F4D: only the F4D has a second channel, and so a register for its set point."""
        try:
            self._table.read(SETPOINT_2)
        except InstrumentError:
            return Identity(manufacturer="Watlow", model="F4S")
        return Identity(manufacturer="Watlow", model="F4D")

    def read(self) -> ChamberReading:
        """Return air temperature, set point, power and alarms; raises `InstrumentError` if the sensor is broken.

        Power is output 1A (heating) minus the magnitude of output 1B (cooling).
        """
        values = self._table.read_together(READING)
        if error := int(values[INPUT_ERROR.name]):
            raise InstrumentError(
                f"{self._link.who}: no valid temperature, input error {error}"
                f" ({INPUT_ERROR_WORDS.get(error, 'see the manual')}); check the chamber's sensor and its wiring"
            )
        return ChamberReading(
            temperature_c=values[AIR.name],
            setpoint_c=values[SETPOINT.name],
            power_percent=values[HEATING.name] - abs(values[COOLING.name]),
            alarms=tuple(
                f"{alarm.name} {ALARM_WORDS.get(code, f'code {code}')}"
                for alarm in ALARMS
                if (code := int(values[alarm.name]))
            ),
        )

    def _check_controller(self) -> None:
        decimals = self._table.read_code(DECIMALS)
        if decimals > MOST_DECIMALS:
            raise InstrumentError(
                f"{self._link.who}: register {DECIMALS.address} reads {decimals},"
                f" expected 0 to {MOST_DECIMALS} decimals; check that it is a Watlow F4"
            )
        if (unit := self._table.read_code(TEMPERATURE_UNIT)) != CELSIUS:
            raise InstrumentError(
                f"{self._link.who}: register {TEMPERATURE_UNIT.address} reads {unit}, expected {CELSIUS} (°C);"
                " set the controller to degrees Celsius"
            )
        self._table.decimals = decimals

    def _switch(self, *, on: bool) -> None:
        if on and (mode := MODE_WORDS.get(self._table.read_code(MODE))):
            raise InstrumentError(
                f"{self._link.who}: it {mode} and would not keep our set point; end the profile on its panel"
            )
        if self._on_event is not None:
            self._table.put(self._on_event, int(on))


Driver = WatlowF4
