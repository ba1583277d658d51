"""The simulated bench with its links: one world, and for each instrument a server with its real protocol.

The keywords of each simulated instrument are derived from its section of bench.toml, so that both ends agree. A keyword
common to a driver and its twin has the same meaning at both ends: a unit's number, a loop, a channel, the word order.
Keywords that only the driver has concern the host only (time-outs, pauses), except those of `BOTH_ENDS`: a twin that
does not accept one of these would differ from the driver's settings.

An address only determines the kind of line to serve: the twin uses its own device or port.

| address     | the twin serves                                                                             |
|-------------|---------------------------------------------------------------------------------------------|
| (none)      | its default                                                                                 |
| `serial://` | a pseudo-terminal; if the system has none, the same bytes over TCP                          |
| `tcp://`    | TCP; for a controller that has only a serial line: its bytes over TCP, as behind a server   |
| `socket://` | of serial ports                                                                             |
| `daqmx://`  | an NI gRPC Device Server                                                                    |
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Self

from benchctl_instruments.catalog import Kind, driver, twin
from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.physics.chain import Effect
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock
from benchctl_instruments.simulated.faults.bench import BenchFaults
from benchctl_instruments.simulated.faults.schedule import FaultTable, Fired
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World

BOTH_ENDS = frozenset(
    {
        "axis",
        "changes",
        "clockwise",
        "encoder_channel",
        "gyro_ain",
        "loop",
        "on_by",
        "on_event",
        "on_number",
        "rs485_address",
        "thermistor_ain",
        "unit_id",
        "word_order",
    }
)
LINE = "over_tcp"


def twin_keywords(
    kind: Kind, model: str, *, options: Mapping[str, Any], address: str | None = None, profile: str = ""
) -> dict[str, Any]:
    """Return the keywords of a model's twin that match a driver with these options at that address.

    `profile` is as for `benchctl_instruments.catalog.twin`.

    Raises
    ------
    UsageError
        If the twin cannot match them.
    """
    takes = inspect.signature(twin(kind, model, profile)).parameters
    usual = inspect.signature(driver(kind, model, profile)).parameters
    for name in sorted(BOTH_ENDS & options.keys() - takes.keys()):
        if name not in usual or options[name] != usual[name].default:
            raise UsageError(
                f"{kind}.options: {name} = {options[name]!r}: the simulated {model} cannot be wired so; leave it out "
                "where simulated is true"
            )
    found = {name: value for name, value in options.items() if name in takes}
    if address is None:
        return found
    serial = parse_address(address).scheme == "serial"
    if LINE in takes:
        return found | {LINE: not serial}
    if serial:
        raise UsageError(
            f"{kind}.address {address!r}: the simulated {model} has no serial line; leave the address out where "
            "simulated is true"
        )
    return found


class SimulatedBench:
    """A world and its servers, started on entry and stopped on exit.

    Parameters
    ----------
    settings
        Settings of the world.
    clock
        Virtual for a campaign in this process, scaled wall time for other programs.
    rate_table, chamber, digitizer
        Models, as in bench.toml.
    chamber_profile
        The text of the profile that `chamber` names, if it has been read already.
    effects
        Effects in addition to the baseline.
    options
        Further keywords of the twins, by instrument: a pace.
    faults
        Faults of the links and machines, and when they occur.
    gyro
        The model of a digital gyro, which also turns with the table; None for no such gyro.
    """

    def __init__(
        self,
        settings: WorldSettings,
        clock: VirtualClock | ScaledClock,
        *,
        rate_table: str,
        chamber: str,
        digitizer: str,
        chamber_profile: str = "",
        effects: Sequence[Effect] = (),
        options: dict[str, dict[str, Any]] | None = None,
        faults: Sequence[FaultTable] = (),
        gyro: str | None = None,
    ) -> None:
        self.world = World(clock, settings, effects)
        self.clock = clock
        more = options or {}
        self._faults = BenchFaults(faults, clock.now)
        table, climate, inputs = self.world.table, self.world.chamber, self.world.inputs
        make_chamber = twin("chamber", chamber, chamber_profile)
        self.rate_table = _made("rate_table", twin("rate_table", rate_table), self._faults.table(table), more)
        self.chamber = _made("chamber", make_chamber, self._faults.chamber(climate), more)
        self.digitizer = _made("digitizer", twin("digitizer", digitizer), self._faults.inputs(inputs), more)
        self._servers = {"rate_table": self.rate_table, "chamber": self.chamber, "digitizer": self.digitizer}
        if gyro is not None:
            make = twin("gyro", gyro)
            self._servers["gyro"] = make(self.world.second_gyro(), settings, **more.get("gyro", {}))
        for name, server in self._servers.items():
            self._faults.befall(name, server)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for server in self._servers.values():
                stack.enter_context(server)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    @property
    def fired(self) -> tuple[Fired, ...]:
        """The faults that have happened so far, oldest first."""
        return self._faults.fired

    @property
    def addresses(self) -> dict[str, str]:
        """The addresses of the instruments by their names in bench.toml; the stream has its own address."""
        found: dict[str, str] = {name: server.address for name, server in self._servers.items()}
        if stream := getattr(self.digitizer, "stream_address", None):
            found["digitizer_stream"] = stream
        return found


def _made(kind: Kind, make: Any, machine: Any, options: Mapping[str, Mapping[str, Any]]) -> Any:
    """Return a twin over its machine; raises `UsageError` for an invalid option."""
    keywords = options.get(kind, {})
    try:
        return make(machine, **keywords)
    except (AttributeError, TypeError, ValueError) as err:
        if not keywords:
            raise
        raise UsageError(f"{kind}.options: its simulated twin cannot be made with {dict(keywords)}: {err}") from err
