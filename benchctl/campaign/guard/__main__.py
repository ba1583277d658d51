"""The guard's process: `python -m benchctl.campaign.guard`, started by a runner, which it outlives.

It ignores SIGINT, SIGTERM and SIGHUP; these must be sent to the runner to end a run. Exit status: 0 if the bench is at
rest or never moved, 3 if it could not be brought to rest.
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
"""Time that a killed runner may take to die and to release its links; the kernel normally needs milliseconds."""


def main() -> int:
    """Watch the runner, and bring the bench to rest if it ends or hangs. Return the exit status."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    # Unbuffered: the reading thread would hold the buffer's lock when the interpreter ends and needs it.
    lines = PipeLines(open(0, "rb", buffering=0, closefd=False))  # noqa: SIM115 - it is read to the end of the process
    line = lines.next(None)
    if not line:
        return 0  # the runner died before it sent its orders, so nothing moves
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
    """Import the code of a rescue during the watch: the runner waits for the first answer, a rescue is urgent."""
    importlib.import_module("benchctl.campaign.guard.rescue")
    from benchctl_instruments.catalog import driver
    from benchctl_instruments.errors import BenchError

    with contextlib.suppress(BenchError):  # errors in the drivers show when they are used
        driver("rate_table", orders.rate_table.model)
        driver("chamber", orders.chamber.model, orders.chamber.profile)


def _answer() -> None:
    with contextlib.suppress(OSError):  # the runner has died; its pipe reports this next
        os.write(sys.stdout.fileno(), f"{HEARD}\n".encode())


def _kill(runner: int) -> None:
    if sys.platform == "win32":
        deadly = signal.SIGTERM  # TerminateProcess: it cannot be ignored there
    elif os.getppid() == runner:
        deadly = signal.SIGKILL
    else:
        return  # it has died, and its process number may be in use again
    with contextlib.suppress(OSError):
        os.kill(runner, deadly)


if __name__ == "__main__":
    sys.exit(main())
