"""The simulated bench on the wire: one world, and a server for each instrument that speaks its real protocol."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Self

from instruments.catalog import twin
from instruments.physics.chain import Effect
from instruments.simulated.clock import ScaledClock, VirtualClock
from instruments.simulated.faults.bench import BenchFaults
from instruments.simulated.faults.log import Fired
from instruments.simulated.faults.tables import FaultTable
from instruments.simulated.settings import WorldSettings
from instruments.simulated.world import World


class SimulatedBench:
    """A world and its servers, started on entry and stopped on exit.

    Parameters
    ----------
    settings
        What the world obeys.
    clock
        Virtual for a campaign in this process, scaled wall time for other programs.
    rate_table, chamber, digitizer
        Models, as in bench.toml.
    effects
        Physics beside the baseline.
    options
        Further keywords of the twins, by instrument: a port, a pace.
    faults
        What goes wrong on the links and in the machines, and when.
    """

    def __init__(
        self,
        settings: WorldSettings,
        clock: VirtualClock | ScaledClock,
        *,
        rate_table: str,
        chamber: str,
        digitizer: str,
        effects: Sequence[Effect] = (),
        options: dict[str, dict[str, Any]] | None = None,
        faults: Sequence[FaultTable] = (),
    ) -> None:
        self.world = World(clock, settings, effects)
        self.clock = clock
        more = options or {}
        self._faults = BenchFaults(faults, clock.now)
        table, climate, inputs = self.world.table, self.world.chamber, self.world.inputs
        self.rate_table = twin("rate_table", rate_table)(self._faults.table(table), **more.get("rate_table", {}))
        self.chamber = twin("chamber", chamber)(self._faults.chamber(climate), **more.get("chamber", {}))
        self.digitizer = twin("digitizer", digitizer)(self._faults.inputs(inputs), **more.get("digitizer", {}))
        for name in ("rate_table", "chamber", "digitizer"):
            self._faults.befall(name, getattr(self, name))
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for server in (self.rate_table, self.chamber, self.digitizer):
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
        """Where the instruments answer, by their names in bench.toml; the stream has an address of its own."""
        found = {
            "rate_table": self.rate_table.address,
            "chamber": self.chamber.address,
            "digitizer": self.digitizer.address,
        }
        if stream := getattr(self.digitizer, "stream_address", None):
            found["digitizer_stream"] = stream
        return found
