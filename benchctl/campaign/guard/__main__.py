"""The guard's process: `python -m benchctl.campaign.guard`, started by a runner, which it outlives.

It is deaf to SIGINT, SIGTERM and SIGHUP: whoever wants the run to end tells the runner. Exit status: 0 where the bench
is at rest or nothing ever moved, 3 where it could not be brought to rest.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import sys
import threading

from benchctl.campaign.guard.orders import HEARD, Ending, Orders, PipeLines, watch

DEATH_S = 5.0
"""How long a killed runner may take to die, which frees its links: the kernel's work, milliseconds as a rule."""


def main() -> int:
    """Watch the runner; where it ends or hangs, bring the bench to rest. Returns the exit status."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    # Without a buffer, whose lock the reading thread would hold when the interpreter ends and wants it.
    lines = PipeLines(open(0, "rb", buffering=0, closefd=False))  # noqa: SIM115 - it is read to the end of the process
    line = lines.next(None)
    if not line:
        return 0  # the runner died before it could say anything, so nothing moves
    orders = Orders.from_line(line)
    threading.Thread(target=_learn, args=(orders,), name="imports").start()
    ending = watch(lines, _answer)
    if ending in (Ending.UNARMED, Ending.DONE):
        return 0
    why = f"{ending.value} (process {orders.runner})"
    if ending is Ending.HANGS:
        _kill(orders.runner)
        why += ", and was killed" if lines.end(DEATH_S) else ", was killed and is not dead yet"
    from benchctl.campaign.guard.rescue import act

    return 0 if act(orders, why) else 3


def _learn(orders: Orders) -> None:
    """Import what acting takes, beside the watch: the runner waits for the first answer, and later time is short."""
    importlib.import_module("benchctl.campaign.guard.rescue")
    from benchctl_instruments.catalog import driver
    from benchctl_instruments.errors import BenchError

    with contextlib.suppress(BenchError):  # what is wrong with them shows when they are used
        driver("rate_table", orders.rate_table.model)
        driver("chamber", orders.chamber.model, orders.chamber.profile)


def _answer() -> None:
    with contextlib.suppress(OSError):  # the runner has died since; its pipe tells next
        os.write(sys.stdout.fileno(), f"{HEARD}\n".encode())


def _kill(runner: int) -> None:
    if sys.platform == "win32":
        deadly = signal.SIGTERM  # TerminateProcess: nobody can ignore it there
    elif os.getppid() == runner:
        deadly = signal.SIGKILL
    else:
        return  # it has died since, and its number may be somebody else's
    with contextlib.suppress(OSError):
        os.kill(runner, deadly)


if __name__ == "__main__":
    sys.exit(main())
