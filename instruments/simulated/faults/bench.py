"""The faults of a complete simulated bench: converts tables to faulty machines and faulty links."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any

from pydantic import Field

from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.faults.link_faults import AnyLinkFault, LinkFault, LinkFaults
from benchctl_instruments.simulated.faults.machines import (
    AnyMachineFault,
    ClockDrift,
    FaultyChamber,
    FaultyInputs,
    FaultyTable,
    MachineFault,
)
from benchctl_instruments.simulated.faults.schedule import FaultTable, Fired, PendingFaults
from benchctl_instruments.simulated.faults.stream_faults import (
    AnyStreamFault,
    FrameFault,
    FrameFaults,
    StreamFault,
)
from benchctl_instruments.simulated.faults.wires import Lines
from benchctl_instruments.simulated.machines import AnalogInputs, ChamberMachine, TableMachine

AnyFault = Annotated[AnyLinkFault | AnyMachineFault | AnyStreamFault | FrameFault, Field(discriminator="kind")]
"""A table of `[[faults]]`, as pydantic parses it."""


class BenchFaults:
    """The faults of one simulated bench; machines and links without faults are returned unchanged.

    Parameters
    ----------
    faults
        In the order in which those of one link are checked.
    now
        Bench time.
    """

    def __init__(self, faults: Iterable[FaultTable], now: Callable[[], float]) -> None:
        self._faults = tuple(faults)
        self._now = now
        self._log: list[Fired] = []

    @property
    def fired(self) -> tuple[Fired, ...]:
        """The faults that have happened, oldest first."""
        return tuple(self._log)

    def table(self, table: TableMachine) -> TableMachine:
        """Return the table with its faults."""
        faults = self._of_machine("rate_table")
        return FaultyTable(table, faults, now=self._now, log=self._log) if faults else table

    def chamber(self, chamber: ChamberMachine) -> ChamberMachine:
        """Return the chamber with its faults."""
        faults = self._of_machine("chamber")
        return FaultyChamber(chamber, faults, now=self._now, log=self._log) if faults else chamber

    def inputs(self, inputs: AnalogInputs) -> AnalogInputs:
        """Return the digitizer's terminals with their faults."""
        faults = self._of_machine("digitizer")
        drifts = [fault for fault in self._faults if isinstance(fault, ClockDrift)]
        return FaultyInputs(inputs, [*faults, *drifts], log=self._log) if faults or drifts else inputs

    def befall(self, name: str, twin: Any) -> None:
        """Give a simulated instrument, not yet started, the faults of its links.

        Raises
        ------
        UsageError
            If it has no link of that kind, or its protocol does not support that fault.
        """
        links = [fault for fault in self._faults if fault.on == name and isinstance(fault, LinkFault)]
        if links:
            _refuse_without(twin, "faults", name, links)
            twin.faults = LinkFaults(
                name,
                links,
                wire=getattr(twin, "wire", Lines()),
                now=self._now,
                happen=lambda what: _happen(twin, what),
                log=self._log,
            )
        stream = f"{name}_stream"
        packets = [fault for fault in self._faults if fault.on == stream and isinstance(fault, StreamFault)]
        if packets:
            _refuse_without(twin, "stream_faults", stream, packets)
            twin.stream_faults = PendingFaults(stream, packets, self._log)
        frames = [fault for fault in self._faults if fault.on == name and isinstance(fault, FrameFault)]
        if frames:
            twin.line.disturb = FrameFaults(twin.frame_bytes, frames, batch_s=lambda: twin.batch_s, log=self._log)

    def _of_machine(self, name: str) -> list[MachineFault]:
        return [fault for fault in self._faults if fault.on == name and isinstance(fault, MachineFault)]


def _refuse_without(twin: Any, attribute: str, name: str, faults: Iterable[FaultTable]) -> None:
    for fault in faults:
        happens = {"interlock_opened": "open_interlock", "following_error": "trip"}.get(fault.kind, attribute)
        if not (hasattr(twin, attribute) and hasattr(twin, happens)):
            raise UsageError(
                f"faults: {fault.kind} cannot happen to the {name} that was chosen: its simulated twin does not play it"
            )


def _happen(twin: Any, what: str) -> None:
    """Apply an event to the instrument; a restart has no effect if it has no volatile state."""
    act = getattr(twin, what, None)
    if act is not None:
        act()
