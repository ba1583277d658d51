"""The states of a simulated ESP301 over a `TableMachine`, without I/O: one line of commands in, its answers out.

How it decides where no source says how the real one does: `MV`, `PA` and `PR` are not allowed while the axis moves
(error 27); a software limit stops the axis and leaves its motor on; the emergency stop and a rate far beyond the axis's
own switch the motor off, and it cannot be switched on while the stop is pressed. The queue holds ten errors and then
forgets the oldest. There are three axes, and the second and third have no stage.
"""

from __future__ import annotations

import math
import threading
from collections import deque

from instruments.errors import InstrumentError
from instruments.protocols.esp301 import DEGREES, Command, Error, parse_commands
from instruments.protocols.lines import parse_number
from instruments.simulated.machines import TableMachine

VERSION = "ESP301 Version 3.0.1 simulated"
AXES = 3
QUEUE = 10
EMERGENCY_STOP, NO_SUCH_COMMAND, OUT_OF_RANGE, NO_SUCH_AXIS, NOT_ALLOWED, AXIS_MISSING, VALUE_MISSING = (
    4,
    6,
    7,
    9,
    27,
    37,
    38,
)
# of axis 1
FOLLOWING, HIGH_LIMIT, LOW_LIMIT, NO_STAGE, TOO_FAST, TOO_STEEP, MOTOR_OFF, INTERLOCK = (
    103,
    106,
    107,
    108,
    110,
    111,
    113,
    129,
)
AT_REST_DPS, AT_ANGLE_DEG = 0.005, 0.005
TRIP = 1.1  # of the axis's rate
WITHOUT_AXIS = ("TE", "TB", "VE")
READINGS = ("TP", "TV", "MD")  # a question mark behind them may be missing
SETTINGS = ("VA", "AC", "AG", "SL", "SR")


class _RejectedError(Exception):
    """A command that leads to an error in the queue."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Esp301Controller:
    """The controller, its stage on axis 1; safe to call from any thread.

    Parameters
    ----------
    table
        The axis; its limits at this moment are the most that `VA`, `AC` and `AG` take.
    """

    def __init__(self, table: TableMachine) -> None:
        self._table = table
        self._lock = threading.Lock()
        self._most_dps, self._most_dps2 = table.limits()
        self._on = False
        self._stop_pressed = False
        self._turns = 0  # the direction of MV
        self._target_deg: float | None = None  # of PA and PR, until the axis is there
        self._errors: deque[int] = deque(maxlen=QUEUE)
        self._heard = 0
        self._set_as_delivered()

    def _set_as_delivered(self) -> None:
        self._settings = {
            "VA": self._most_dps,
            "AC": self._most_dps2,
            "AG": self._most_dps2,
            "SL": -math.inf,
            "SR": math.inf,
        }
        self._origin_deg = 0.0

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
        """A following error: the motor is off, and the error queue says so."""
        with self._lock:
            self._trip(FOLLOWING)

    def restart(self) -> None:
        """Start anew, as after a power failure: the motor off, no errors, every setting as delivered."""
        with self._lock:
            self._switch_off()
            self._errors.clear()
            self._set_as_delivered()

    def execute(self, line: str) -> list[str]:
        """Obey one line; the answers of its queries."""
        answers: list[str] = []
        with self._lock:
            for command in parse_commands(line):
                self._heard += 1
                self._watch()
                try:
                    if command is None:
                        raise _RejectedError(NO_SUCH_COMMAND)
                    answer = self._obey(command)
                except _RejectedError as err:
                    self._errors.append(err.code)
                    continue
                if answer is not None:
                    answers.append(answer)
        return answers

    # One command ------------------------------------------------------------------------------------------------------

    def _obey(self, command: Command) -> str | None:
        """Do it; the answer of a query, None for a command."""
        name, value = command.name, command.value
        if name in WITHOUT_AXIS:
            return self._without_axis(name)
        if command.axis is None:
            raise _RejectedError(AXIS_MISSING)
        if not 1 <= command.axis <= AXES:
            raise _RejectedError(NO_SUCH_AXIS)
        if command.axis > 1:
            raise _RejectedError(NO_STAGE + 100 * (command.axis - 1))
        if command.query or name in READINGS:
            return self._state_of(name)
        match name:
            case "MO":
                self._switch_on()
            case "MF":
                self._switch_off()
            case "ST" | "AB":
                self._stop()
            case "MV":
                self._turn(value)
            case "PA" | "PR":
                self._move(_number(value), relative=name == "PR")
            case "DH":
                self._origin_deg += self._angle_deg() - (_number(value) if value else 0.0)
            case _ if name in SETTINGS:
                self._set(name, _number(value))
            case _:
                raise _RejectedError(NO_SUCH_COMMAND)
        return None

    def _without_axis(self, name: str) -> str:
        if name == "VE":
            return VERSION
        code = self._errors.popleft() if self._errors else 0
        if name == "TE":
            return str(code)
        return f"{code}, {self._heard}, {Error(code=code).text.upper() if code else 'NO ERROR DETECTED'}"

    def _state_of(self, name: str) -> str:
        match name:
            case "TP":
                return f"{self._angle_deg():.6f}"
            case "TV":
                return f"{self._table.motion().rate_dps:.6f}"
            case "MD" | "MV":
                return "0" if self._moves() else "1"
            case "MO":
                return "1" if self._on else "0"
            case "SN":
                return str(DEGREES)
            case _ if name in SETTINGS:
                return f"{self._settings[name]:.6f}"
            case _:
                raise _RejectedError(NO_SUCH_COMMAND)

    def _set(self, name: str, value: float) -> None:
        if name in ("VA", "AC", "AG"):
            if value <= 0.0:
                raise _RejectedError(OUT_OF_RANGE)
            if value > (self._most_dps if name == "VA" else self._most_dps2):
                raise _RejectedError(TOO_FAST if name == "VA" else TOO_STEEP)
        self._settings[name] = value
        if name == "VA" and self._turns:
            self._demand_rate()

    # The states -------------------------------------------------------------------------------------------------------

    def _angle_deg(self) -> float:
        return self._table.motion().angle_deg - self._origin_deg

    def _moves(self) -> bool:
        return self._turns != 0 or self._target_deg is not None or abs(self._table.motion().rate_dps) > AT_REST_DPS

    def _switch_on(self) -> None:
        if self._stop_pressed:
            raise _RejectedError(INTERLOCK)
        if not self._on:
            self._on = True
            self._table.close_loop()

    def _switch_off(self) -> None:
        self._on = False
        self._turns, self._target_deg = 0, None
        self._table.open_loop()

    def _stop(self) -> None:
        self._turns, self._target_deg = 0, None
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
        here_deg = self._angle_deg()
        self._target_deg = here_deg + position_deg if relative else position_deg
        self._table.set_limits(self._settings["VA"], self._settings["AC"])
        self._table.demand_angle(self._target_deg + self._origin_deg)

    def _refuse_motion(self) -> None:
        if not self._on:
            raise _RejectedError(MOTOR_OFF)
        if self._moves():
            raise _RejectedError(NOT_ALLOWED)

    def _watch(self) -> None:
        """See whether a move has ended, and what has tripped."""
        rate_dps, angle_deg = self._table.motion().rate_dps, self._angle_deg()
        if self._target_deg is not None and abs(rate_dps) < AT_REST_DPS:
            arrived = abs(self._target_deg - angle_deg) < AT_ANGLE_DEG
            self._target_deg = None if arrived else self._target_deg
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
