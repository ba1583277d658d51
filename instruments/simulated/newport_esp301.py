"""A simulated ESP301 on a serial line. It shares only the protocol with the driver.

It implements the parameters that PyMeasure's, InstrumentKit's and EPICS' drivers use. After power-up the axis counts
from its present angle; `OR` turns it to the home index, at the table's 0 deg, and counts from there. `WS` and `WP`
delay the commands after them, `ST` too. `SN` names the unit and converts nothing.

Behaviour chosen without a source: `MV`, `PA`, `PR` and `OR` are not allowed while the axis moves (error 27, or 30 of
the axis during homing); a move beyond a software limit is refused, and a limit reached by `MV` stops the axis and
leaves its motor on; the emergency stop and a rate far beyond the axis's own switch the motor off, and it cannot be
switched on while the stop is pressed. A search for a limit switch, which the stage does not have, is aborted. The queue
holds ten errors and then drops the oldest. There are three axes, and the second and third have no stage. Programs and
groups of axes do not exist.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.esp301 import ANSWER_END, DEGREES, SENT_END, Error, Esp301Command, parse_commands
from benchctl_instruments.protocols.lines import LineCutter, parse_number
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.serial_line import LineConversation, SerialLine, TableServer

VERSION = "ESP301 Version 3.0.1 simulated"
STAGE = "SIMULATED, SN1"
AXES = 3
QUEUE = 10
EMERGENCY_STOP, NO_SUCH_COMMAND, OUT_OF_RANGE, NO_SUCH_AXIS = 4, 6, 7, 9
NOT_ALLOWED, AXIS_MISSING, VALUE_MISSING = 27, 37, 38
# of axis 1
BEYOND, FOLLOWING, HIGH_LIMIT, LOW_LIMIT, NO_STAGE, TOO_FAST, TOO_STEEP = 101, 103, 106, 107, 108, 110, 111
MOTOR_OFF, HOMING_ABORTED, INTERLOCK, DURING_HOMING = 113, 120, 129, 130
AT_REST_DPS, AT_ANGLE_DEG = 0.005, 0.005
TRIP = 1.1  # relative to the axis's rate
POLL_S = 0.002  # wall time between two polls of an axis
WITHOUT_AXIS = ("TE", "TB", "VE", "*IDN", "TS", "PH", "SM", "RS")
READINGS = ("TP", "TV", "MD")  # the question mark after them may be missing
WITHOUT_EFFECT = ("UF", "QD", "QR")  # servo filter and motor driver take their new parameters

RATES, RAMPS = ("VA", "VU", "JH", "OH"), ("AC", "AG", "AE", "AU")  # as delivered the axis's rate and acceleration
MOST = {"VA": ("VU", TOO_FAST), "AC": ("AU", TOO_STEEP), "AG": ("AU", TOO_STEEP)}
NUMBERS = {  # deg, s, A, V
    **{"SL": -1e9, "SR": 1e9, "DH": 0.0, "VB": 0.0, "JW": 10.0, "OL": 10.0, "JK": 1e5, "FE": 1.0, "DB": 0.0},
    **{"SU": 0.0005, "FR": 0.01, "QI": 2.0, "QV": 48.0, "QT": 7.0, "QG": 1.0, "BA": 0.0, "CO": 0.0, "GR": 1.0},
    **{"KP": 10.0, "KI": 1.0, "KD": 5.0, "KS": 50.0, "AF": 0.0, "VF": 0.0, "DO": 0.0},
}
INTEGERS = {  # as delivered, least, most
    **{"SN": (DEGREES, 0, 11), "QM": (1, 0, 4), "FP": (4, 0, 7), "TJ": (1, 1, 6), "QS": (100, 1, 1000), "OM": (0, 0, 6)}
}
BITS = {"ZA": 0x123, "ZB": 0x300, "ZE": 0x3, "ZF": 0x3, "ZH": 0x24, "ZS": 0x24}
COMMANDS = ("MO", "MF", "ST", "AB", "MV", "MT", "PA", "PR", "OR", "WS", "WP", "DP", "DV", "ID")
OF_AXIS = {*COMMANDS, *READINGS, *WITHOUT_EFFECT, *RATES, *RAMPS, *NUMBERS, *INTEGERS, *BITS}


class _RejectedError(Exception):
    """A command that causes an error in the queue."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Esp301Controller:
    """The controller, with its stage on axis 1. Thread-safe.

    Parameters
    ----------
    table
        The axis; its present limits are the largest values that `VA`, `AC` and `AG` accept.
    """

    def __init__(self, table: TableMachine) -> None:
        self._table = table
        self._lock = threading.Lock()
        self._most_dps, self._most_dps2 = table.limits()
        self._on = False
        self._stop_pressed = False
        self._turns = 0  # the direction of MV
        self._target_deg: float | None = None  # of PA, PR and OR, until the axis has reached it
        self._stops = True  # until it has come to rest; the servo's hunting about its place does not count as motion
        self._index_deg: float | None = None  # the home index of OR, as the table counts
        self._waits: tuple[Callable[[], bool], float] | None = None  # the condition of WS or WP, and the delay after it
        self.closing = threading.Event()
        self._errors: deque[int] = deque(maxlen=QUEUE)
        self._heard = 0
        self._set_as_delivered()

    def _set_as_delivered(self) -> None:
        self._settings = dict.fromkeys(RATES, self._most_dps) | dict.fromkeys(RAMPS, self._most_dps2) | NUMBERS
        self._integers = {name: value for name, (value, _, _) in INTEGERS.items()} | BITS
        self._origin_deg = self._table.motion().angle_deg

    def open_interlock(self) -> None:
        """Press the emergency stop: the motor is off until it is released and switched on again."""
        with self._lock:
            self._stop_pressed = True
            self._trip(EMERGENCY_STOP)

    def close_interlock(self) -> None:
        """Release the emergency stop; the motor stays off."""
        with self._lock:
            self._stop_pressed = False

    def trip(self) -> None:
        """Cause a following error: the motor is off, and the error queue contains it."""
        with self._lock:
            self._trip(FOLLOWING)

    def restart(self) -> None:
        """Restart, as after a power failure: the motor off, not homed, no errors, every setting as delivered."""
        with self._lock:
            self._restart()

    def execute(self, line: str) -> list[str]:
        """Execute one line and return the answers to its queries; returns after WS and WP have finished."""
        answers: list[str] = []
        for command in parse_commands(line):
            with self._lock:
                answer = self._answer(command)
                waits, self._waits = self._waits, None
            if answer is not None:
                answers.append(answer)
            if waits is not None:
                self._hold(*waits)
        return answers

    def _hold(self, there: Callable[[], bool], more_s: float) -> None:
        """Delay later commands until `there` returns true, and by `more_s` of wall time after that."""
        while not self.closing.wait(POLL_S):
            with self._lock:
                self._watch()
                if there():
                    break
        self.closing.wait(more_s)

    # One command ------------------------------------------------------------------------------------------------------

    def _answer(self, command: Esp301Command | None) -> str | None:
        """Return the answer to a query; None for a command, and for an error, which is queued."""
        self._heard += 1
        self._watch()
        try:
            if command is None:
                raise _RejectedError(NO_SUCH_COMMAND)
            return self._obey(command)
        except _RejectedError as err:
            self._errors.append(err.code)
            return None

    def _obey(self, command: Esp301Command) -> str | None:
        """Execute a command; return the answer to a query, or None."""
        name, value = command.name, command.value
        if name in WITHOUT_AXIS:
            return self._without_axis(name)
        if name not in OF_AXIS:
            raise _RejectedError(NO_SUCH_COMMAND)
        axis = 1 if command.axis is None and name in ("ST", "AB") else command.axis  # without one: all axes
        if axis is None:
            raise _RejectedError(AXIS_MISSING)
        if not 1 <= axis <= AXES:
            raise _RejectedError(NO_SUCH_AXIS)
        if axis > 1:
            raise _RejectedError(NO_STAGE + 100 * (axis - 1))
        if command.query or name in READINGS:
            return self._state_of(name)
        match name:
            case "MO":
                self._switch_on()
            case "MF":
                self._switch_off()
            case "ST" | "AB":
                self._stop()
            case "MV" | "MT":  # the stage has no hardware limit
                self._turn(value)
            case "PA" | "PR":
                self._move(_number(value), relative=name == "PR")
            case "OR":
                self._home(_number(value) if value else self._integers["OM"])
            case "WS":
                self._wait_for_rest(_number(value) if value else 0.0)
            case "WP":
                self._wait_for_angle(_number(value))
            case "DH":
                self._settings["DH"] = _number(value) if value else 0.0
                self._origin_deg += self._angle_deg() - self._settings["DH"]
            case _ if name in self._settings or name in self._integers:
                self._set(name, value)
        return None

    def _without_axis(self, name: str) -> str | None:
        match name:
            case "SM":  # accepted; after power-up settings are as delivered
                return None
            case "RS":
                self._restart()
                return None
            case "VE" | "*IDN":
                return VERSION
            case "TS":
                return chr(0x40 | self._on << 4 | self._moves())
            case "PH":
                return "0H, 0H"
        code = self._errors.popleft() if self._errors else 0
        if name == "TE":
            return str(code)
        return f"{code}, {self._heard}, {Error(code=code).text.upper() if code else 'NO ERROR DETECTED'}"

    def _state_of(self, name: str) -> str:
        match name:
            case "TP":
                return f"{self._angle_deg():.6f}"
            case "DP":
                return f"{self._angle_deg() if self._target_deg is None else self._target_deg:.6f}"
            case "TV":
                return f"{self._table.motion().rate_dps:.6f}"
            case "DV":
                return f"{self._turns * self._settings['VA']:.6f}"
            case "MD" | "MV":
                return "0" if self._moves() else "1"
            case "MO":
                return "1" if self._on else "0"
            case "ID":
                return STAGE
            case _ if name in BITS:
                return f"{self._integers[name]:X}H"
            case _ if name in self._integers:
                return str(self._integers[name])
            case _ if name in self._settings:
                return f"{self._settings[name]:.6f}"
            case _:
                raise _RejectedError(NO_SUCH_COMMAND)

    def _set(self, name: str, value: str) -> None:
        if name in BITS:
            self._integers[name] = _bits(value)
            return
        number = _number(value)
        if name in INTEGERS:
            _, least, most = INTEGERS[name]
            if number != int(number) or not least <= number <= most:
                raise _RejectedError(OUT_OF_RANGE)
            self._integers[name] = int(number)
            return
        if name in RATES or name in RAMPS:
            highest, code = MOST.get(name, ("", BEYOND))
            owned = self._most_dps if name in RATES else self._most_dps2
            if number <= 0.0:
                raise _RejectedError(OUT_OF_RANGE)
            if number > self._settings.get(highest, owned):
                raise _RejectedError(code)
        self._settings[name] = number
        if name == "VA" and self._turns:
            self._demand_rate()

    # The states -------------------------------------------------------------------------------------------------------

    def _angle_deg(self) -> float:
        return self._table.motion().angle_deg - self._origin_deg

    def _moves(self) -> bool:
        self._settle()
        return self._turns != 0 or self._target_deg is not None or self._stops

    def _settle(self) -> None:
        self._stops = self._stops and abs(self._table.motion().rate_dps) > AT_REST_DPS

    def _switch_on(self) -> None:
        if self._stop_pressed:
            raise _RejectedError(INTERLOCK)
        if not self._on:
            self._on = True
            self._table.close_loop()

    def _switch_off(self) -> None:
        self._end_motion()
        self._on = False
        self._table.open_loop()

    def _end_motion(self) -> None:
        self._turns, self._target_deg, self._index_deg, self._stops = 0, None, None, True

    def _restart(self) -> None:
        self._switch_off()
        self._errors.clear()
        self._set_as_delivered()

    def _stop(self) -> None:
        self._end_motion()
        if self._on:
            self._table.set_limits(self._most_dps, self._settings["AG"])
            self._table.demand_rate(0.0)

    def _turn(self, value: str) -> None:
        if value not in ("+", "-"):
            raise _RejectedError(OUT_OF_RANGE if value else VALUE_MISSING)
        self._refuse_motion()
        self._turns = 1 if value == "+" else -1
        self._demand_rate()

    def _demand_rate(self) -> None:
        self._table.set_limits(self._most_dps, self._settings["AC"])
        self._table.demand_rate(self._turns * self._settings["VA"])

    def _move(self, position_deg: float, *, relative: bool) -> None:
        self._refuse_motion()
        target_deg = self._angle_deg() + position_deg if relative else position_deg
        if target_deg > self._settings["SR"] or target_deg < self._settings["SL"]:
            raise _RejectedError(HIGH_LIMIT if target_deg > self._settings["SR"] else LOW_LIMIT)
        self._target_deg = target_deg
        self._table.set_limits(self._settings["VA"], self._settings["AC"])
        self._table.demand_angle(self._target_deg + self._origin_deg)

    def _home(self, mode: float) -> None:
        """0: go to the angle 0; 1, 2: go to the home index and count from there; 3 to 6: search for a limit switch."""
        self._refuse_motion()
        if mode not in range(7):
            raise _RejectedError(OUT_OF_RANGE)
        if mode > 2:
            raise _RejectedError(HOMING_ABORTED)
        here_deg = self._table.motion().angle_deg
        self._index_deg = self._origin_deg if mode == 0 else 360.0 * round(here_deg / 360.0)
        self._target_deg = self._index_deg - self._origin_deg
        self._table.set_limits(self._settings["OH"], self._settings["AC"])
        self._table.demand_angle(self._index_deg)

    def _wait_for_rest(self, more_ms: float) -> None:
        if not 0.0 <= more_ms <= 60_000.0:
            raise _RejectedError(OUT_OF_RANGE)
        self._waits = lambda: not self._moves(), more_ms * 1e-3

    def _wait_for_angle(self, angle_deg: float) -> None:
        below = self._angle_deg() < angle_deg
        self._waits = lambda: (self._angle_deg() < angle_deg) != below or not self._moves(), 0.0

    def _refuse_motion(self) -> None:
        if not self._on:
            raise _RejectedError(MOTOR_OFF)
        if self._moves():
            raise _RejectedError(NOT_ALLOWED if self._index_deg is None else DURING_HOMING)

    def _watch(self) -> None:
        """Detect the end of a move, and faults."""
        rate_dps, angle_deg = self._table.motion().rate_dps, self._angle_deg()
        self._settle()
        arrived = self._target_deg is not None and abs(self._target_deg - angle_deg) < AT_ANGLE_DEG
        if arrived and abs(rate_dps) < AT_REST_DPS:
            self._origin_deg = self._origin_deg if self._index_deg is None else self._index_deg
            self._target_deg = self._index_deg = None
        if not self._on:
            return
        if abs(rate_dps) > TRIP * self._most_dps:
            self._trip(FOLLOWING)
        elif self._turns != 0 or self._target_deg is not None:
            self._watch_limits(angle_deg, rate_dps)

    def _watch_limits(self, angle_deg: float, rate_dps: float) -> None:
        if angle_deg > self._settings["SR"] and rate_dps > AT_REST_DPS:
            self._errors.append(HIGH_LIMIT)
            self._stop()
        elif angle_deg < self._settings["SL"] and rate_dps < -AT_REST_DPS:
            self._errors.append(LOW_LIMIT)
            self._stop()

    def _trip(self, code: int) -> None:
        self._errors.append(code)
        self._switch_off()


def _number(value: str) -> float:
    if not value:
        raise _RejectedError(VALUE_MISSING)
    try:
        return parse_number(value)
    except InstrumentError as err:
        raise _RejectedError(OUT_OF_RANGE) from err


def _bits(value: str) -> int:
    """Return a number from hexadecimal digits and an H, or from decimal ones."""
    if not value:
        raise _RejectedError(VALUE_MISSING)
    try:
        return int(value.rstrip("Hh"), 16 if value[-1] in "Hh" else 10)
    except ValueError as err:
        raise _RejectedError(OUT_OF_RANGE) from err


class SimulatedEsp301(TableServer):
    """Serves a simulated table, axis 1, on a pseudo-terminal, or as serial over TCP.

    Parameters
    ----------
    table
        The axis; its present limits are the largest values that the controller accepts.
    pace_baud, over_tcp
        See `SerialLine`.
    """

    wire: Wire = Lines()  # refused commands are not answered

    def __init__(self, table: TableMachine, *, pace_baud: int | None = None, over_tcp: bool = False) -> None:
        controller = Esp301Controller(table)

        def answer(line: str) -> bytes:
            return b"".join(text.encode("ascii") + ANSWER_END for text in controller.execute(line))

        line = SerialLine(
            lambda: LineConversation(answer, LineCutter(SENT_END)), pace_baud=pace_baud, over_tcp=over_tcp
        )
        super().__init__(controller, line)


Twin = SimulatedEsp301
