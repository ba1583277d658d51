"""The states of a simulated Ensemble over a `TableMachine`, without I/O: one line of commands in, its reply out.

It counts clockwise. How it decides where no source says how the real one does: `!` is for what does not exist, such as
another axis or a number that is none; `#` for what cannot be done now, such as a motion while the axis is disabled or
another kind of motion goes on; `$` for a move in a wait mode that waits for its end, which then goes on. Beyond a
software limit, beyond the drive's rate and at the emergency stop the axis is disabled, and its fault is latched.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from instruments.errors import InstrumentError, UsageError
from instruments.protocols.ensemble import (
    ABORT_DECELERATION,
    PLANE_MOVES,
    AxisStatus,
    Command,
    Outcome,
    Reply,
    parse_command,
    written_bits,
)
from instruments.protocols.lines import parse_number
from instruments.simulated.machines import TableMachine

POSITION_ERROR, CW_SOFTWARE_LIMIT, CCW_SOFTWARE_LIMIT, RATE_COMMAND, EMERGENCY_STOP, RATE_ERROR = 0, 4, 5, 10, 11, 12
HIGH_LIMIT, LOW_LIMIT = 38, 37  # parameters: software limits [deg]; both 0: none
AT_ANGLE_DEG, AT_REST_DPS = 0.005, 0.005
TRIP = 1.1  # of the drive's rate
MODES = {"WAIT MODE": ("NOWAIT", "MOVEDONE", "INPOS"), "RAMP MODE": ("RATE",)}


class _RefusedError(Exception):
    """What exists and cannot be done now."""


class EnsembleController:
    """The controller of one axis, number 0, also called X; safe to call from any thread.

    Parameters
    ----------
    table
        The axis; its limits at this moment are those of the drive.
    """

    def __init__(self, table: TableMachine) -> None:
        self._table = table
        self._lock = threading.Lock()
        self._most_dps, self._most_dps2 = table.limits()
        self._enabled = False
        self._faults = 0
        self._stop_pressed = False
        self._rate_dps = 0.0  # of FREERUN
        self._target_deg: float | None = None  # of LINEAR, while it goes on
        self._set_as_delivered()

    def _set_as_delivered(self) -> None:
        self._parameters = {ABORT_DECELERATION: self._most_dps2, HIGH_LIMIT: 0.0, LOW_LIMIT: 0.0}
        self._ramp_dps2 = self._plane_ramp_dps2 = self._most_dps2
        self._incremental = False
        self._waits = True

    def open_interlock(self) -> None:
        """Press the emergency stop: the axis is disabled and in fault, until it is released and acknowledged."""
        with self._lock:
            self._stop_pressed = True
            self._trip(EMERGENCY_STOP)

    def close_interlock(self) -> None:
        """Release the emergency stop; the fault stays latched."""
        with self._lock:
            self._stop_pressed = False

    def trip(self) -> None:
        """A position error: the axis is disabled and in fault, until that is acknowledged."""
        with self._lock:
            self._trip(POSITION_ERROR)

    def restart(self) -> None:
        """Start anew, as after a power failure: disabled, without a fault that is over, every setting as delivered."""
        with self._lock:
            self._disable()
            self._acknowledge()
            self._set_as_delivered()

    def execute(self, line: str) -> Reply:
        """Obey one line."""
        with self._lock:
            self._watch()
            try:
                reply = self._obey(parse_command(line))
            except (UsageError, InstrumentError):  # no command, or no number in it
                return Reply(outcome=Outcome.NOT_UNDERSTOOD)
            except _RefusedError:
                return Reply(outcome=Outcome.REFUSED)
            self._watch()
            return reply

    # One command ------------------------------------------------------------------------------------------------------

    def _obey(self, command: Command) -> Reply:
        words = command.arguments
        match command.name:
            case "AXISSTATUS" | "AXISFAULT" | "PFBK" | "PFBKPROG" | "PCMDPROG" | "VFBK":
                _of_axis_0(words, 0)
                return Reply(outcome=Outcome.DONE, data=self._state_of(command.name))
            case "PLANESTATUS":
                _expect(words == ("0",))
                return Reply(outcome=Outcome.DONE, data=str(0 if self._target_deg is None else PLANE_MOVES))
            case "GETPARM":
                return Reply(outcome=Outcome.DONE, data=f"{self._parameters[self._parameter(words, 1)]:.6f}")
            case "SETPARM":
                self._parameters[self._parameter(words, 2)] = parse_number(words[2])
            case "WAIT MODE":
                self._waits = _chosen(command.name, words) != "NOWAIT"
            case "RAMP MODE":
                _chosen(command.name, _of_axis_0(words, 1))
            case "RAMP RATE":
                self._set_ramp(words)
            case "ABS" | "INC":
                _expect(not words)
                self._incremental = command.name == "INC"
            case "FREERUN":
                self._turn(parse_number(_of_axis_0(words, 1)[0]))
            case "LINEAR":
                return self._move(*_of_axis_0(words, 2))
            case "ENABLE" | "DISABLE" | "ABORT" | "FAULTACK":
                _of_axis_0(words, 0)
                self._actions()[command.name]()
            case _:
                raise UsageError(f"{command.name} is not simulated")
        return Reply(outcome=Outcome.DONE)

    def _state_of(self, name: str) -> str:
        motion = self._table.motion()
        if name == "AXISSTATUS":
            return written_bits(self._status())
        if name == "AXISFAULT":
            return written_bits(self._faults)
        return f"{0.0 - (motion.rate_dps if name == 'VFBK' else motion.angle_deg):.6f}"

    def _parameter(self, words: Sequence[str], count: int) -> int:
        number = _of_axis_0(words, count)[0]
        _expect(number.isdecimal() and int(number) in self._parameters)
        return int(number)

    def _set_ramp(self, words: Sequence[str]) -> None:
        of_axis = len(words) == 2
        ramp_dps2 = parse_number(_of_axis_0(words, 1)[0] if of_axis else " ".join(words))
        _expect(0.0 < ramp_dps2 <= self._most_dps2)
        if of_axis:
            self._ramp_dps2 = ramp_dps2
        else:
            self._plane_ramp_dps2 = ramp_dps2

    # The states -------------------------------------------------------------------------------------------------------

    def _actions(self) -> dict[str, Callable[[], None]]:
        return {"ENABLE": self._enable, "DISABLE": self._disable, "ABORT": self._abort, "FAULTACK": self._acknowledge}

    def _status(self) -> AxisStatus:
        rate_dps = self._table.motion().rate_dps
        turns = self._rate_dps != 0.0 or (self._target_deg is None and abs(rate_dps) > AT_REST_DPS)
        shown = {
            AxisStatus.ENABLED: self._enabled,
            AxisStatus.IN_POSITION: not turns and self._target_deg is None,
            AxisStatus.MOVE_ACTIVE: turns,
            AxisStatus.COUNTER_CLOCKWISE: rate_dps > 0.0,
            AxisStatus.EMERGENCY_STOP_INPUT: not self._stop_pressed,
        }
        return AxisStatus(sum(bit for bit, on in shown.items() if on))

    def _enable(self) -> None:
        if self._faults:
            raise _RefusedError
        if not self._enabled:
            self._enabled = True
            self._table.close_loop()

    def _disable(self) -> None:
        self._enabled = False
        self._rate_dps, self._target_deg = 0.0, None
        self._table.open_loop()

    def _acknowledge(self) -> None:
        self._faults = 1 << EMERGENCY_STOP if self._stop_pressed else 0

    def _abort(self) -> None:
        self._rate_dps, self._target_deg = 0.0, None
        if self._enabled:
            self._demand(0.0, self._parameters[ABORT_DECELERATION])

    def _turn(self, rate_dps: float) -> None:
        if not self._enabled or self._target_deg is not None:
            raise _RefusedError
        if abs(rate_dps) > self._most_dps:
            self._trip(RATE_COMMAND)
            return
        self._rate_dps = rate_dps
        self._demand(rate_dps, self._ramp_dps2)

    def _move(self, position: str, speed: str) -> Reply:
        _expect(speed[:1].upper() == "F")
        rate_dps, position_deg = parse_number(speed[1:]), parse_number(position)
        _expect(rate_dps > 0.0)
        if not self._enabled or self._target_deg is not None or self._status() & AxisStatus.MOVE_ACTIVE:
            raise _RefusedError
        if rate_dps > self._most_dps:
            self._trip(RATE_COMMAND)
            return Reply(outcome=Outcome.DONE)
        here_deg = -self._table.motion().angle_deg
        self._target_deg = here_deg + position_deg if self._incremental else position_deg
        self._table.set_limits(rate_dps, self._plane_ramp_dps2)
        self._table.demand_angle(-self._target_deg)
        return Reply(outcome=Outcome.NOT_IN_TIME if self._waits else Outcome.DONE)

    def _demand(self, rate_dps: float, ramp_dps2: float) -> None:
        self._table.set_limits(self._most_dps, min(ramp_dps2, self._most_dps2))
        self._table.demand_rate(-rate_dps)

    def _watch(self) -> None:
        """See whether a move has ended, and what has tripped."""
        motion = self._table.motion()
        angle_deg, rate_dps = -motion.angle_deg, -motion.rate_dps
        if self._target_deg is not None and abs(rate_dps) < AT_REST_DPS:
            arrived = abs(self._target_deg - angle_deg) < AT_ANGLE_DEG
            self._target_deg = None if arrived else self._target_deg
        if not self._enabled:
            return
        low_deg, high_deg = self._parameters[LOW_LIMIT], self._parameters[HIGH_LIMIT]
        limited = low_deg < high_deg
        if limited and angle_deg > high_deg and rate_dps > AT_REST_DPS:
            self._trip(CW_SOFTWARE_LIMIT)
        elif limited and angle_deg < low_deg and rate_dps < -AT_REST_DPS:
            self._trip(CCW_SOFTWARE_LIMIT)
        elif abs(rate_dps) > TRIP * self._most_dps:
            self._trip(RATE_ERROR)

    def _trip(self, fault: int) -> None:
        self._faults |= 1 << fault
        self._disable()


def _expect(met: bool) -> None:
    if not met:
        raise UsageError("there is none, or not so")


def _of_axis_0(words: Sequence[str], count: int) -> Sequence[str]:
    """What follows the name of axis 0: so many words."""
    _expect(len(words) == 1 + count and words[0].upper() in ("@0", "X"))
    return words[1:]


def _chosen(name: str, words: Sequence[str]) -> str:
    _expect(len(words) == 1 and words[0].upper() in MODES[name])
    return words[0].upper()
