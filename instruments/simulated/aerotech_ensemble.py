"""A simulated Ensemble server. It shares only the protocol with the driver.

It implements the commands and parameters that epics-motor, robmarkcole/aerotech, lab-control-lib and ESRF's bliss use.
The table is axis X or A; Y or B and Z or C are separate stages. It counts clockwise. After power-up an axis counts from
its present angle; HOME turns it to its home marker, at the table's 0 deg, and counts from there.

Behaviour chosen without a source: `!` is answered for what does not exist, such as another axis or an invalid number;
`#` for what is impossible now, such as a motion while the axis is disabled or another kind of motion is running. HOME,
and in a wait mode that waits every move, is answered at its end; if that takes longer than the command time-out, `$` is
answered, and the motion continues. Beyond a software limit, beyond the drive's rate and at the emergency stop the axis
is disabled, and its fault is latched.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.physics.table import TableParameters
from benchctl_instruments.protocols.ensemble import (
    ABORT_DECELERATION,
    END,
    HOME_RAMP,
    HOME_SPEED,
    PLANE_MOVES,
    AxisStatus,
    EnsembleCommand,
    Outcome,
    Reply,
    encode_reply,
    parse_command,
    written_bits,
)
from benchctl_instruments.protocols.lines import LineCutter, parse_number
from benchctl_instruments.simulated.axis import TableAxis
from benchctl_instruments.simulated.clock import ScaledClock, Timebase
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.serial_line import LineConversation, TableServer
from benchctl_instruments.simulated.tcp_server import TcpServer

VERSION = "5.6.1 simulated"
NAMES = ("X", "A", "@0"), ("Y", "B", "@1"), ("Z", "C", "@2")  # of each axis
HOME_PROGRAM = "HOMEASYNC.BCX"  # homes the axis of IGLOBAL(33) and answers at once
POSITION_ERROR, CW_SOFTWARE_LIMIT, CCW_SOFTWARE_LIMIT, RATE_COMMAND, EMERGENCY_STOP, RATE_ERROR = 0, 4, 5, 10, 11, 12
# numbers of parameters
COUNTS_PER_UNIT, LOW_LIMIT, HIGH_LIMIT, FEEDBACK_TYPE = 2, 37, 38, 47
DEFAULT_SPEED, DEFAULT_RAMP, HOME_OFFSET = 71, 72, 77
AXIS_NAME, TIMEOUT_MS = 140, 202
PARAMETERS = {  # in addition to rates and ramps; both software limits 0: none [deg]
    **dict.fromkeys((1, LOW_LIMIT, HIGH_LIMIT, 61, 74, 75, HOME_OFFSET), 0.0),
    **{COUNTS_PER_UNIT: 1000.0, FEEDBACK_TYPE: 2.0, TIMEOUT_MS: 60_000.0},
}
AT_ANGLE_DEG, AT_REST_DPS = 0.005, 0.005
TRIP = 1.1  # relative to the drive's rate
POLL_S = 0.002  # wall time between two polls of a running motion
MODES = {"WAIT MODE": ("NOWAIT", "MOVEDONE", "INPOS"), "RAMP MODE": ("RATE",)}
_MOVE = re.compile(r"(?:(?P<axis>@\d|[A-CX-Z])\s*)?(?P<speed>F)?\s*(?P<value>[+-]?[\d.]+(?:E[+-]?\d+)?)(?:\s+|$)")


class _RefusedError(Exception):
    """The command exists but is impossible now."""


class _Axis:
    """One axis; the present limits of its table become those of the drive."""

    def __init__(self, table: TableMachine) -> None:
        self.table = table
        self.most_dps, self.most_dps2 = table.limits()
        self.enabled = False
        self.faults = 0
        self.stop_pressed = False
        self.rate_dps = 0.0  # of FREERUN
        self.target_deg: float | None = None  # of a running move, as the table counts
        self.in_plane = False  # whether that move is a LINEAR
        self.homing = False
        self.stopping = True  # until it has come to rest; the servo's hunting about its place does not count as motion
        self.set_as_delivered()

    def set_as_delivered(self) -> None:
        rates = dict.fromkeys((DEFAULT_SPEED, HOME_SPEED), self.most_dps)
        ramps = dict.fromkeys((DEFAULT_RAMP, ABORT_DECELERATION, HOME_RAMP), self.most_dps2)
        self.parameters = PARAMETERS | rates | ramps
        self.ramp_dps2 = self.most_dps2
        self.homed = False
        self.origin_deg = -self.table.motion().angle_deg
        self.offset_deg = 0.0  # of POSOFFSET

    @property
    def angle_deg(self) -> float:
        """The angle of the feedback; programs add `offset_deg`."""
        return -self.table.motion().angle_deg - self.origin_deg

    @property
    def turns(self) -> bool:
        if self.target_deg is not None:
            return not self.in_plane
        return self.rate_dps != 0.0 or self.stopping

    def status(self) -> AxisStatus:
        shown = {
            AxisStatus.ENABLED: self.enabled,
            AxisStatus.HOMED: self.homed,
            AxisStatus.IN_POSITION: not self.turns and self.target_deg is None,
            AxisStatus.MOVE_ACTIVE: self.turns,
            AxisStatus.COUNTER_CLOCKWISE: self.table.motion().rate_dps > 0.0,
            AxisStatus.HOMING: self.homing,
            AxisStatus.EMERGENCY_STOP_INPUT: not self.stop_pressed,
        }
        return AxisStatus(sum(bit for bit, on in shown.items() if on))

    def enable(self) -> None:
        if self.faults:
            raise _RefusedError
        if not self.enabled:
            self.enabled = True
            self.table.close_loop()

    def disable(self) -> None:
        self.enabled = self.homing = False
        self.rate_dps, self.target_deg, self.stopping = 0.0, None, True
        self.table.open_loop()

    def acknowledge(self) -> None:
        self.faults = 1 << EMERGENCY_STOP if self.stop_pressed else 0

    def abort(self) -> None:
        self.rate_dps, self.target_deg, self.homing, self.stopping = 0.0, None, False, True
        if self.enabled:
            self._demand(0.0, self.parameters[ABORT_DECELERATION])

    def turn(self, rate_dps: float) -> None:
        if not self.enabled or self.target_deg is not None:
            raise _RefusedError
        if abs(rate_dps) > self.most_dps:
            self.trip(RATE_COMMAND)
            return
        self.rate_dps, self.stopping = rate_dps, True
        self._demand(rate_dps, self.ramp_dps2)

    def refuse_move(self) -> None:
        if not self.enabled or self.target_deg is not None or self.turns:
            raise _RefusedError

    def move(self, to_deg: float, rate_dps: float, ramp_dps2: float, *, in_plane: bool) -> None:
        """Start to move to an angle, as the table counts clockwise."""
        if rate_dps > self.most_dps:
            self.trip(RATE_COMMAND)
            return
        self.target_deg, self.in_plane = to_deg, in_plane
        self.table.set_limits(rate_dps, ramp_dps2)
        self.table.demand_angle(-to_deg)

    def home(self) -> None:
        self.refuse_move()
        self.homed, self.homing = False, True
        marker_deg = 360.0 * round(-self.table.motion().angle_deg / 360.0)
        self.move(marker_deg, self.parameters[HOME_SPEED], self.parameters[HOME_RAMP], in_plane=False)

    def watch(self) -> None:
        """Detect the end of a move, and faults."""
        motion = self.table.motion()
        angle_deg, rate_dps = self.angle_deg, -motion.rate_dps
        self.stopping = self.rate_dps != 0.0 or (self.stopping and abs(rate_dps) > AT_REST_DPS)
        arrived = self.target_deg is not None and abs(self.target_deg + motion.angle_deg) < AT_ANGLE_DEG
        if arrived and self.target_deg is not None and abs(rate_dps) < AT_REST_DPS:
            if self.homing:
                self.origin_deg = self.target_deg - self.parameters[HOME_OFFSET]
                self.homed, self.homing, self.offset_deg = True, False, 0.0
            self.target_deg = None
        if not self.enabled:
            return
        low_deg, high_deg = self.parameters[LOW_LIMIT], self.parameters[HIGH_LIMIT]
        limited = low_deg < high_deg
        if limited and angle_deg > high_deg and rate_dps > AT_REST_DPS:
            self.trip(CW_SOFTWARE_LIMIT)
        elif limited and angle_deg < low_deg and rate_dps < -AT_REST_DPS:
            self.trip(CCW_SOFTWARE_LIMIT)
        elif abs(rate_dps) > TRIP * self.most_dps:
            self.trip(RATE_ERROR)

    def trip(self, fault: int) -> None:
        self.faults |= 1 << fault
        self.disable()

    def _demand(self, rate_dps: float, ramp_dps2: float) -> None:
        self.table.set_limits(self.most_dps, min(ramp_dps2, self.most_dps2))
        self.table.demand_rate(-rate_dps)


class EnsembleController:
    """The controller of three axes, the table on the first. Thread-safe.

    Parameters
    ----------
    table
        The axis; its present limits become those of the drive.
    """

    def __init__(self, table: TableMachine) -> None:
        others = (TableAxis(Timebase(ScaledClock(), 1000.0), TableParameters()) for _ in NAMES[1:])
        self._axes = [_Axis(one) for one in (table, *others)]
        self._lock = threading.Lock()
        self.closing = threading.Event()
        self._set_as_delivered()

    def _set_as_delivered(self) -> None:
        self._plane_ramp_dps2 = self._axes[0].most_dps2
        self._incremental = False
        self._waits = True
        self._globals: dict[int, float] = {}
        self._moved: Sequence[_Axis] = ()  # axes for whose motion the reply waits

    def open_interlock(self) -> None:
        """Press the emergency stop: the axis is disabled and in fault, until it is released and acknowledged."""
        with self._lock:
            self._axes[0].stop_pressed = True
            self._axes[0].trip(EMERGENCY_STOP)

    def close_interlock(self) -> None:
        """Release the emergency stop; the fault stays latched."""
        with self._lock:
            self._axes[0].stop_pressed = False

    def trip(self) -> None:
        """Cause a position error: the axis is disabled and in fault, until that is acknowledged."""
        with self._lock:
            self._axes[0].trip(POSITION_ERROR)

    def restart(self) -> None:
        """Restart, as after a power failure: disabled, not homed, only persistent faults, settings as delivered."""
        with self._lock:
            for axis in self._axes:
                axis.disable()
                axis.acknowledge()
                axis.set_as_delivered()
            self._set_as_delivered()

    def execute(self, line: str) -> Reply:
        """Execute one line; if the reply waits for a motion, return at the end of the motion."""
        with self._lock:
            self._watch()
            try:
                reply = self._obey(parse_command(line))
            except (UsageError, InstrumentError):  # an invalid command, or an invalid number in it
                return Reply(outcome=Outcome.NOT_UNDERSTOOD)
            except _RefusedError:
                return Reply(outcome=Outcome.REFUSED)
            self._watch()
            moved, self._moved = self._moved, ()
            until_s = time.monotonic() + self._axes[0].parameters[TIMEOUT_MS] * 1e-3
        while any(axis.target_deg is not None for axis in moved):
            if self.closing.wait(POLL_S) or time.monotonic() > until_s:
                return Reply(outcome=Outcome.NOT_IN_TIME)
            with self._lock:
                self._watch()
        return Reply(outcome=Outcome.REFUSED) if any(axis.faults for axis in moved) else reply

    def _watch(self) -> None:
        for axis in self._axes:
            axis.watch()

    # One command ------------------------------------------------------------------------------------------------------

    def _obey(self, command: EnsembleCommand) -> Reply:
        name, words = command.name, command.arguments
        match name:
            case "VERSION":
                return _done(VERSION)
            case "AXISSTATUS" | "AXISFAULT" | "PFBK" | "PFBKCAL" | "PFBKPROG" | "PCMDPROG" | "CMDPOS" | "VFBK":
                return _done(self._state_of(name, self._one(words)))
            case "PLANESTATUS":
                _expect(words == ("0",))
                return _done(
                    str(PLANE_MOVES * any(axis.target_deg is not None and axis.in_plane for axis in self._axes))
                )
            case "GETPARM" if words[1:] == (str(AXIS_NAME),):
                return _done(NAMES[self._axes.index(self._one(words[:1]))][0])
            case "GETPARM":
                axis, number = self._parameter(words, 2)
                return _done(f"{axis.parameters[number]:.6f}")
            case "SETPARM":
                axis, number = self._parameter(words, 3)
                axis.parameters[number] = parse_number(words[2])
            case "IGLOBAL":
                _expect(len(words) == 3 and words[1] == "=")
                self._globals[_whole(words[0])] = parse_number(words[2])
            case "PROGRAM RUN":
                _expect(len(words) == 2 and words[1].strip('"').upper() == HOME_PROGRAM)
                self._one([f"@{self._globals.get(33, 0):.0f}"]).home()
            case "WAIT MODE":
                self._waits = _chosen(name, words) != "NOWAIT"
            case "RAMP MODE":
                _chosen(name, words[-1:])
                self._some(words[:-1])
            case "RAMP RATE":
                self._set_ramp(words)
            case "SCURVE":
                _expect(len(words) == 1 and 0.0 <= parse_number(words[0]) <= 100.0)
            case "ABS" | "INC":
                _expect(not words)
                self._incremental = name == "INC"
            case "POSOFFSET SET":
                _expect(len(words) == 2)
                axis = self._one(words[:1])
                axis.offset_deg = parse_number(words[1]) - axis.angle_deg
            case "POSOFFSET CLEAR":
                self._one(words).offset_deg = 0.0
            case "FREERUN":
                _expect(len(words) == 2)
                self._one(words[:1]).turn(parse_number(words[1]))
            case "LINEAR" | "MOVEABS" | "MOVEINC":
                self._move(name, words)
            case "HOME":
                self._moved = self._some(words, least=1)
                for axis in self._moved:
                    axis.home()
            case "ACKNOWLEDGEALL" | "ABORT":
                _act(name, self._some(words) or self._axes)
            case "ENABLE" | "DISABLE" | "FAULTACK":
                _act(name, self._some(words, least=1))
            case _:
                raise UsageError(f"{name} is not simulated")
        return _done()

    def _state_of(self, name: str, axis: _Axis) -> str:
        if name == "AXISSTATUS":
            return written_bits(axis.status())
        if name == "AXISFAULT":
            return written_bits(axis.faults)
        if name == "VFBK":
            return f"{0.0 - axis.table.motion().rate_dps:.6f}"
        return f"{axis.angle_deg + axis.offset_deg * name.endswith('PROG') + 0.0:.6f}"

    def _one(self, words: Sequence[str]) -> _Axis:
        """Return the named axis."""
        _expect(len(words) == 1)
        named = [words[0].upper() in names for names in NAMES]
        _expect(any(named))
        return self._axes[named.index(True)]

    def _some(self, words: Iterable[str], *, least: int = 0) -> list[_Axis]:
        """Return the named axes; each may be named once."""
        axes = [self._one([word]) for word in words]
        _expect(len(axes) >= least and len(set(axes)) == len(axes))
        return axes

    def _parameter(self, words: Sequence[str], count: int) -> tuple[_Axis, int]:
        axis = self._one(words[:1])
        _expect(len(words) == count and _whole(words[1]) in axis.parameters)
        return axis, int(words[1])

    def _set_ramp(self, words: Sequence[str]) -> None:
        *names, ramp = words or ("",)
        ramp_dps2, axes = parse_number(ramp), self._some(names)
        _expect(0.0 < ramp_dps2 <= min(axis.most_dps2 for axis in axes or self._axes[:1]))
        for axis in axes:
            axis.ramp_dps2 = ramp_dps2
        if not axes:
            self._plane_ramp_dps2 = ramp_dps2

    def _move(self, name: str, words: Sequence[str]) -> None:
        """Execute `X 10 XF 5 Y 3 YF 5`, or with one speed for all, `X 10 F 5`; blanks may be missing."""
        text = " ".join(words).upper()
        parts = list(_MOVE.finditer(text))
        _expect("".join(part.group() for part in parts) == text)
        goals: dict[_Axis, float] = {}
        speeds: dict[_Axis | None, float] = {}
        for part in parts:
            axis = self._one([part["axis"]]) if part["axis"] else None
            if part["speed"]:
                speeds[axis] = parse_number(part["value"])
            elif axis is None or axis in goals:
                raise UsageError("two angles for one axis, or one for none")
            else:
                goals[axis] = parse_number(part["value"])
        _expect(bool(goals) and speeds.keys() <= {*goals, None} and all(speed > 0.0 for speed in speeds.values()))
        for axis in goals:
            axis.refuse_move()
        by = name == "MOVEINC" or (name == "LINEAR" and self._incremental)
        for axis, goal in goals.items():
            start_deg = -axis.table.motion().angle_deg if by else axis.origin_deg - axis.offset_deg
            rate_dps = speeds.get(axis, speeds.get(None, axis.parameters[DEFAULT_SPEED]))
            ramp_dps2 = self._plane_ramp_dps2 if name == "LINEAR" else axis.ramp_dps2
            axis.move(start_deg + goal, rate_dps, ramp_dps2, in_plane=name == "LINEAR")
        self._moved = list(goals) if self._waits else ()


def _done(data: str = "") -> Reply:
    return Reply(outcome=Outcome.DONE, data=data)


def _act(name: str, axes: Iterable[_Axis]) -> None:
    actions: dict[str, Callable[[_Axis], None]] = {
        "ENABLE": _Axis.enable,
        "DISABLE": _Axis.disable,
        "ABORT": _Axis.abort,
        "FAULTACK": _Axis.acknowledge,
        "ACKNOWLEDGEALL": _Axis.acknowledge,
    }
    for axis in axes:
        actions[name](axis)


def _expect(met: bool) -> None:
    if not met:
        raise UsageError("there is none, or not so")


def _whole(word: str) -> int:
    _expect(word.isascii() and word.isdecimal())
    return int(word)


def _chosen(name: str, words: Sequence[str]) -> str:
    _expect(len(words) == 1 and words[0].upper() in MODES[name])
    return words[0].upper()


class SimulatedEnsemble(TableServer):
    """Serves a simulated table, axis X of three, at `tcp://host:port`; several clients may use it at once.

    Parameters
    ----------
    table
        The axis; its present limits become those of the drive.
    bare_lines
        Precede data with a bare `%` line, as observed on real controllers.
    """

    wire: Wire = Lines(refusal_line=encode_reply(Reply(outcome=Outcome.REFUSED)))

    def __init__(self, table: TableMachine, *, bare_lines: bool = False) -> None:
        controller = EnsembleController(table)
        bare = encode_reply(Reply(outcome=Outcome.DONE)) if bare_lines else b""

        def answer(line: str) -> bytes:
            reply = controller.execute(line)
            return bare * bool(reply.data) + encode_reply(reply)

        super().__init__(controller, TcpServer(lambda: LineConversation(answer, LineCutter(END))))


Twin = SimulatedEnsemble
