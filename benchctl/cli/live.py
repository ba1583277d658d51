"""The live line at the terminal: step, set point, temperature, rate, time left; on stderr, and only on a terminal."""

from __future__ import annotations

import io
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, cast

from benchctl.campaign.progress import Moment, Progress, nobody
from benchctl.cli.output import let_go
from benchctl.cli.words import duration

REDRAW_S = 0.1


class _Terminal(io.TextIOBase):
    """A terminal on stderr that may go away, its window closed or its connection lost, without ending the run."""

    def __init__(self) -> None:
        self._stream = sys.stderr  # as it is now: while bars are drawn, rich puts itself in its place

    @property
    def encoding(self) -> str:  # type: ignore[override]  # an attribute there, which io gives no way to set
        return self._stream.encoding

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError:
            let_go(self._stream)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            let_go(self._stream)

    def fileno(self) -> int:
        return self._stream.fileno()

    def isatty(self) -> bool:
        return True


@contextmanager
def live_progress(quiet: bool) -> Iterator[Progress]:
    """Somebody to tell how the run goes: a terminal where there is one, else nobody."""
    if quiet or not sys.stderr.isatty():
        yield nobody
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=20), TextColumn("{task.fields[now]}"))
    with Bars(*columns, console=Console(file=cast("IO[str]", _Terminal())), transient=True, auto_refresh=False) as bars:
        task = bars.add_task("opening the bench", total=1.0, now="")
        drawn_s = 0.0

        def show(moment: Moment) -> None:
            nonlocal drawn_s
            if time.monotonic() - drawn_s < REDRAW_S:
                return
            drawn_s = time.monotonic()
            bars.update(
                task,
                total=moment.count,
                completed=moment.index - 1,
                description=f"step {moment.index}/{moment.count} {moment.label}, {moment.doing}",
                now=(
                    f"set {moment.setpoint_c:+.1f} °C, air {_known(moment.air_c, '+.1f')}, "
                    f"gyro {_known(moment.gyro_c, '+.2f')}, "
                    f"{moment.rate_dps:+.1f} deg/s, {moment.samples:,} samples, {duration(moment.left_s)} left"
                ),
            )
            bars.refresh()

        yield show


def _known(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "not known yet"
