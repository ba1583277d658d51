"""When a machine's fault begins and ends: a look at the machine may begin it, and then it lasts for a while."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from typing import Generic, TypeVar

from benchctl_instruments.simulated.faults.log import FaultLog, Fired
from benchctl_instruments.simulated.faults.machine_kinds import MachineFault
from benchctl_instruments.simulated.faults.schedule import Schedule

FaultT = TypeVar("FaultT", bound=MachineFault)


class Spell(Generic[FaultT]):
    """One fault of one machine; safe from any thread.

    Parameters
    ----------
    where
        The instrument's name, as the log states it.
    fault
        What happens, and when.
    log
        Where to note it.

    Attributes
    ----------
    since_s
        When it last began, in bench time: with its window, where it did so between two looks, else with a look.
    """

    def __init__(self, where: str, fault: FaultT, log: FaultLog) -> None:
        self.fault = fault
        self.since_s = math.inf
        self._where = where
        self._schedule = Schedule(fault.when)
        self._log = log
        self._until_s = self._looked_s = -math.inf
        self._lock = threading.Lock()

    def lasts(self, operation: str, now_s: float) -> bool:
        """Take a look at the machine into account: what is done, and the bench time; whether the fault is there."""
        with self._lock:
            if now_s >= self._until_s and self._schedule.fires(operation, now_s):
                self.since_s = self.fault.from_s if self._looked_s < self.fault.from_s else now_s
                self._until_s = now_s + self.fault.for_s
                fired = Fired(bench_s=now_s, where=self._where, kind=self.fault.kind, operation=operation)
                self._log.note(fired)
            self._looked_s = now_s
            return now_s < self._until_s


def spells(where: str, faults: Iterable[object], kind: type[FaultT], log: FaultLog) -> list[Spell[FaultT]]:
    """Those of a machine's faults that are of one kind."""
    return [Spell(where, fault, log) for fault in faults if isinstance(fault, kind)]
