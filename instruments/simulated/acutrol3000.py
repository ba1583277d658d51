"""A simulated ACUTROL3000 server. It shares only ACL with the driver.

Behaviour chosen without a source: a refusal is `ERROR` and a reason; the interlock answers `Open`, `Closed` or `Fault`;
a demand beyond a limit is refused completely. A velocity trip, a following error or an interlock opened manually leads
to Abort, with the servo off, latched until reset.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.protocols.acl import AclCommand, encode_reply, parse_commands
from benchctl_instruments.protocols.lines import LineCutter, parse_number
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.serial_line import LineConversation, TableServer
from benchctl_instruments.simulated.tcp_server import TcpServer

IDENTITY = "simulated,ACUTROL3000,1,0"
STATUS_FAULT = 65  # observed on a real controller with its interlock in fault
MODE_NAMES = {"off": "Off", "position": "Position", "rate": "Rate", "arate": "AbsRate", "synthesizer": "Synthesizer"}
LIMITED_MODES = ("position", "rate", "synthesizer", "abort", "arate")
_PER_DEGREE: dict[str, Callable[[float], float]] = {  # degrees per unit of an oscillation's amplitude
    "pos": lambda omega: 1.0,
    "rate": lambda omega: 1.0 / omega,
    "accel": lambda omega: 1.0 / omega**2,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Oscillator:
    """The synthesizer's settings: amplitude in units of `kind`, its slew rate in those units per second."""

    amplitude: float = 0.0
    frequency_hz: float = 0.0
    phase_deg: float = 0.0
    slew: float = 10.0
    frequency_slew: float = 1.0
    kind: str = "Pos"

    def amplitude_deg(self, amount: float) -> float:
        """Return an amplitude, or a slew rate, in degrees."""
        if self.frequency_hz <= 0.0:
            return 0.0
        return amount * _PER_DEGREE[self.kind.lower()](2.0 * math.pi * self.frequency_hz)


class AcutrolController:
    """The controller of one axis, number 1. Thread-safe.

    Parameters
    ----------
    table
        The axis; its present limits become the factory limits.
    """

    def __init__(self, table: TableMachine) -> None:
        self._table = table
        self._lock = threading.Lock()
        self.closing = threading.Event()
        self._factory_limits = table.limits()
        self._limits = dict.fromkeys(LIMITED_MODES, self._factory_limits)
        self._velocity_trip_dps = 1.1 * self._factory_limits[0]
        self._mode = "off"
        self._closed = False
        self._fault = False
        self._opened_by_hand = False
        self._rate_dps = 0.0
        self._angle_deg = 0.0
        self._acceleration_dps2 = 0.0
        self._oscillator = Oscillator()

    def open_interlock(self) -> None:
        """Open the interlock, as an emergency stop does: servo off and in fault, until closed and reset."""
        with self._lock:
            self._opened_by_hand = True
            self._abort()

    def close_interlock(self) -> None:
        """Close the interlock; the fault stays latched."""
        with self._lock:
            self._opened_by_hand = False

    def trip(self) -> None:
        """Abort, as after a following error: servo off and in fault, until reset."""
        with self._lock:
            self._abort()

    def restart(self) -> None:
        """Restart, as after a power failure: servo off, no demands, factory limits, and only faults that persist."""
        with self._lock:
            self._fault = self._opened_by_hand
            self._open_loop()
            self._limits = dict.fromkeys(LIMITED_MODES, self._factory_limits)
            self._table.set_limits(*self._factory_limits)
            self._rate_dps = self._angle_deg = 0.0
            self._oscillator = Oscillator()

    def execute(self, line: str) -> str:
        """Execute one line and return the data of its reply."""
        answers: list[str] = []
        with self._lock:
            try:
                for command in parse_commands(line):
                    self._check_velocity()
                    answer = self._obey(command)
                    if answer is not None:
                        answers.append(answer)
            except UsageError as err:
                answers.append(f"ERROR {err}")
        return ";".join(answers) or "OK"

    # One command ------------------------------------------------------------------------------------------------------

    def _obey(self, command: AclCommand) -> str | None:
        """Execute a command; return the answer to a query, or None."""
        match command.path, command.query:
            case ("*idn",), True:
                return IDENTITY
            case ("*stb",), True:
                return str(STATUS_FAULT if self._fault else 0)
            case ("interlock", "reset"), False:
                self._reset()
                return None
            case ("utility", _) | ("configure", "window"), False:  # the front panel
                return None
            case ("limit", "acceleration" | "rate" as limited), query:
                return self._limit(limited, query, command.arguments)
            case ("limit", "vtrip" | "lposition" | "hposition" as other), False:
                self._limit_whole_axis(other, command.arguments)
                return None
            case ("limit",), False:
                words = [*command.arguments, "", "", "", ""]  # axis, mode, rate, acceleration, jerk
                self._limit("rate", False, [words[1], words[0], words[2]])
                self._limit("acceleration", False, [words[1], words[0], words[3]])
                return None
        arguments = _of_axis_1(command.arguments)
        match command.path, command.query:
            case ("read", what), True:
                return self._read(what)
            case ("mode",), True:
                return "Abort" if self._mode == "abort" else MODE_NAMES[self._mode]
            case ("mode", mode), False:
                self._enter(mode)
            case ("interlock",), True:
                return "Fault" if self._fault else "Closed" if self._closed else "Open"
            case ("interlock", "close"), False:
                self._close_loop()
            case ("interlock", "open"), False:
                self._open_loop()
            case ("demand", what), True:
                return self._demanded(what)
            case ("demand", what), False:
                self._demand(what, arguments)
            case ("configure", "oscillator"), True:
                o = self._oscillator
                return f"Enable,{o.slew:.6f},{o.frequency_slew:.6f},{o.kind},Lin"
            case ("configure", "oscillator"), False:
                self._configure(arguments)
            case ("limit", "absolute"), True:
                rate, acceleration = self._factory_limits
                return f"{rate:.6f},{acceleration:.6f},0,-360,360,{self._velocity_trip_dps:.6f}"
            case _:
                raise UsageError(f"{':'.join(command.path)}{'?' * command.query} is not simulated")
        return None

    def _read(self, what: str) -> str:
        motion = self._table.motion()
        value = {
            "position": motion.angle_deg % 360.0,
            "rate": motion.rate_dps,
            "acceleration": motion.acceleration_dps2,
        }[what]
        return f"{value:.6f}"

    def _limit(self, what: str, query: bool, arguments: Sequence[str]) -> str | None:
        mode = _limited_mode(arguments[0]) if arguments else None
        if mode is None:
            raise UsageError(f"limit {what}: expected a mode, an axis and a number")
        rest = _of_axis_1(arguments[1:])
        rate, acceleration = self._limits[mode]
        if query:
            return f"{rate if what == 'rate' else acceleration:.6f}"
        (value,) = _numbers(rest, 1)
        most = self._factory_limits[0 if what == "rate" else 1]
        if not 0.0 < value <= most:
            raise UsageError(f"limit {what} {value}: the factory's limit is {most}")
        self._limits[mode] = (value, acceleration) if what == "rate" else (rate, value)
        if mode == self._mode:
            self._table.set_limits(*self._limits[mode])
        return None

    def _limit_whole_axis(self, what: str, arguments: Sequence[str]) -> None:
        """Set a limit, with or without a mode; limits of the position are accepted and ignored."""
        if arguments and _limited_mode(arguments[0]):
            arguments = arguments[1:]
        (value,) = _numbers(_of_axis_1(arguments), 1)
        if what == "vtrip":
            self._velocity_trip_dps = value

    def _demanded(self, what: str) -> str:
        o = self._oscillator
        answers = {
            "rate": f"{self._rate_dps:.6f}",
            "position": f"{self._angle_deg % 360.0:.6f}",
            "acceleration": f"{self._acceleration_dps2:.6f}",
            "oscillator": f"{o.amplitude:.6f},{o.frequency_hz:.6f},{o.phase_deg:.6f}",
        }
        if what not in answers:
            raise UsageError(f"demand:{what}? is not simulated")
        return answers[what]

    def _demand(self, what: str, arguments: Sequence[str]) -> None:
        """Load a demand; it acts at once if its mode is on, otherwise when its mode is entered."""
        if what == "rate":
            (rate_dps,) = _numbers(arguments, 1)
            _within("rate", rate_dps, self._limits["rate"][0])
            self._rate_dps = rate_dps
            self._act("rate", "arate")
        elif what == "position":
            (angle_deg,) = _numbers(arguments, 1)
            self._angle_deg += _short_way(self._angle_deg, angle_deg)
            self._act("position")
        elif what == "acceleration":  # no mode of the axis acts on it
            (self._acceleration_dps2,) = _numbers(arguments, 1)
        elif what == "delta":
            (delta_deg,) = _numbers(arguments, 1)
            _within("delta", delta_deg, 180.0)
            self._angle_deg += delta_deg
            self._act("position")
        elif what == "oscillator":
            amplitude, frequency_hz, phase_deg = _numbers(arguments, 3)
            self._load_oscillation(amplitude, frequency_hz, phase_deg)
            self._act("synthesizer")
        else:
            raise UsageError(f"demand:{what} is not simulated")

    def _load_oscillation(self, amplitude: float, frequency_hz: float, phase_deg: float) -> None:
        new = replace(self._oscillator, amplitude=amplitude, frequency_hz=frequency_hz, phase_deg=phase_deg)
        omega = 2.0 * math.pi * frequency_hz
        rate, acceleration = self._limits["synthesizer"]
        _within("oscillation's rate", omega * new.amplitude_deg(amplitude), rate)
        _within("oscillation's acceleration", omega**2 * new.amplitude_deg(amplitude), acceleration)
        self._oscillator = new

    def _configure(self, arguments: Sequence[str]) -> None:
        words = [word.lower() for word in arguments]
        if len(words) != 5 or words[0] != "enable" or words[3] not in _PER_DEGREE or words[4] != "lin":
            raise UsageError("simulated are Enable, two slew rates, Pos or Rate or Accel, and Lin")
        slew, frequency_slew = _numbers(words[1:3], 2)
        self._oscillator = replace(
            self._oscillator, slew=slew, frequency_slew=frequency_slew, kind=words[3].capitalize()
        )

    # The states -------------------------------------------------------------------------------------------------------

    def _enter(self, mode: str) -> None:
        if mode != "off" and not self._closed:
            raise UsageError(f"mode {MODE_NAMES[mode]}: the interlock is {'in fault' if self._fault else 'open'}")
        if mode == "off":
            if self._closed:
                self._table.demand_rate(0.0)
            self._mode = "abort" if self._fault else "off"
            return
        self._mode = mode
        self._table.set_limits(*self._limits[mode])
        self._act(mode)

    def _act(self, *modes: str) -> None:
        """Pass the loaded demand to the axis if it is in one of these modes."""
        if self._mode not in modes:
            return
        if self._mode == "position":
            here_deg = self._table.motion().angle_deg
            self._table.demand_angle(here_deg + _short_way(here_deg, self._angle_deg))
        elif self._mode == "synthesizer":
            o = self._oscillator
            amplitude_deg, slew_deg_per_s = o.amplitude_deg(o.amplitude), o.amplitude_deg(o.slew)
            if amplitude_deg == 0.0:
                self._table.demand_rate(0.0)
            else:
                self._table.demand_sine(amplitude_deg, o.frequency_hz, o.phase_deg, slew_deg_per_s)
        else:
            self._table.demand_rate(self._rate_dps)

    def _close_loop(self) -> None:
        if self._fault:
            raise UsageError("interlock close: it is in fault, reset it first")
        if not self._closed:
            self._closed = True
            self._table.close_loop()

    def _open_loop(self) -> None:
        self._closed = False
        self._mode = "abort" if self._fault else "off"
        self._table.open_loop()

    def _reset(self) -> None:
        if self._fault and not self._opened_by_hand:
            self._fault, self._mode = False, "off"

    def _abort(self) -> None:
        self._fault = True
        self._open_loop()

    def _check_velocity(self) -> None:
        if self._closed and abs(self._table.motion().rate_dps) > self._velocity_trip_dps:
            self._abort()


def _of_axis_1(arguments: Sequence[str]) -> Sequence[str]:
    if not arguments or arguments[0].lower() not in ("1", "all"):
        raise UsageError("expected axis 1")
    return arguments[1:]


def _limited_mode(name: str) -> str | None:
    return next((mode for mode in LIMITED_MODES if name and mode.startswith(name.lower())), None)


def _numbers(words: Sequence[str], count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(map(parse_number, words))
    except InstrumentError:
        numbers = ()
    if len(numbers) != count:
        raise UsageError(f"expected {count} numbers, not {','.join(words)!r}")
    return numbers


def _short_way(from_deg: float, to_deg: float) -> float:
    return (to_deg - from_deg + 180.0) % 360.0 - 180.0


def _within(what: str, value: float, limit: float) -> None:
    if not abs(value) <= limit:
        raise UsageError(f"{what} {value}: the limit is {limit}")


class SimulatedAcutrol3000(TableServer):
    """Serves a simulated table, axis 1, at `tcp://host:port`; several clients may use it at once.

    Parameters
    ----------
    table
        The axis; its present limits become the factory limits.
    """

    wire: Wire = Lines(refusal_line=encode_reply("00000000", "ERROR not now"))

    def __init__(self, table: TableMachine) -> None:
        controller = AcutrolController(table)

        def connect() -> LineConversation:
            count = itertools.count(1)  # each reply has its own header
            return LineConversation(
                lambda line: encode_reply(f"{next(count) % 10**8:08d}", controller.execute(line)), LineCutter()
            )

        super().__init__(controller, TcpServer(connect))


Twin = SimulatedAcutrol3000
