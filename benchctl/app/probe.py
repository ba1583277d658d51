"""Ask an unknown device which drivers recognise it; nothing on it changes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from benchctl.campaign.reserved import BenchInUseError, lock_files, make_lock_folder
from benchctl.locks import held
from benchctl_instruments.errors import LinkError, UsageError
from benchctl_instruments.probe import Inquiry, Match, Probe
from benchctl_instruments.simulated.clock import ScaledClock


@dataclass(frozen=True, slots=True)
class Probed:
    """The questions in the order in which they were sent, and the drivers that recognise the device, best first."""

    exchanges: tuple[Inquiry, ...]
    matches: tuple[Match, ...]

    def require_match(self, address: str) -> None:
        """Raise `LinkError` if nothing answered, and `UsageError` if no driver recognises what did."""
        if not any(exchange.received for exchange in self.exchanges):
            raise LinkError(
                f"{address}: no answer to {len(self.exchanges)} questions; check power, wiring (TX and RX, A and B),"
                " speed, unit number, and whether it accepts remote control"
            )
        if not self.matches:
            raise UsageError(
                f"{address}: a device answers, and no driver recognises it; check the speed if its bytes make no sense,"
                " or write its driver: benchctl help new_driver"
            )


def probe(
    address: str, *, unit_id: int = 1, timeout_s: float = 1.0, tell: Callable[[Inquiry], None] = lambda _: None
) -> Probed:
    """Ask the device at an address as bench.toml writes it; `tell` is called with every question and its answer.

    Raises
    ------
    UsageError
        If the address is invalid.
    LinkError
        If no connection can be made.
    BenchInUseError
        If another process of this machine holds the address; nothing is sent.
    """
    exchanges: list[Inquiry] = []

    def note(exchange: Inquiry) -> None:
        exchanges.append(exchange)
        tell(exchange)

    asks = Probe(address, clock=ScaledClock(), unit_id=unit_id, timeout_s=timeout_s, tell=note)
    make_lock_folder()
    with ExitStack() as stack:
        lock = held(lock_files(address), f"the device at {address}", "benchctl instrument probe", settles=False)
        try:
            stack.enter_context(lock)
        except UsageError as err:
            raise BenchInUseError(str(err)) from err
        matches = asks.matches()
    return Probed(tuple(exchanges), tuple(matches))


def bench_lines(match: Match) -> list[str]:
    """Return the lines of bench.toml for an instrument that was recognised."""
    lines = [f"[{match.kind}]", f'model = "{match.model}"', f'address = "{match.address}"']
    if match.options:
        lines += [f"[{match.kind}.options]", *(f"{name} = {value}" for name, value in match.options.items())]
    return lines
