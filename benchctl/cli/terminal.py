"""Show the progress of a campaign or a diagnosis on stderr; the work continues if the terminal disappears."""

from __future__ import annotations

import io
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, cast

from benchctl.campaign.runner import Moment, Progress, no_progress
from benchctl.cli.messages import duration, let_go

if TYPE_CHECKING:  # rich is loaded only at a terminal
    from rich.progress import Progress as Bars
    from rich.progress import ProgressColumn

REDRAW_S = 0.1

Draw = Callable[[str, float, str], None]
"""Called with a description of the current work, the completed fraction, and a remark after the bar."""


class _Terminal(io.TextIOBase):
    """stderr; write errors, after its window is closed or its connection is lost, are ignored."""

    def __init__(self) -> None:
        self._stream = sys.stderr  # the current one: rich replaces sys.stderr while it draws bars

    @property
    def encoding(self) -> str:  # type: ignore[override]  # an attribute in io.TextIOBase, which cannot be set
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
def progress_bar(beginning: str, quiet: bool) -> Iterator[Draw | None]:
    """Show a bar on stderr, redrawn a few times per second; yield None if quiet or stderr is not a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=20), TextColumn("{task.fields[now]}"))
    with _bars(*columns, auto_refresh=False) as bars:
        task = bars.add_task(beginning, total=1.0, now="")
        drawn_s = 0.0

        def draw(doing: str, share: float, now: str) -> None:
            nonlocal drawn_s
            if time.monotonic() - drawn_s < REDRAW_S:
                return
            drawn_s = time.monotonic()
            bars.update(task, completed=share, description=doing, now=now)
            bars.refresh()

        yield draw


@contextmanager
def working(doing: str, quiet: bool) -> Iterator[None]:
    """Show on stderr, for work of unknown length, what is done and for how long; nothing if quiet or no terminal."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn("line"), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with _bars(*columns, auto_refresh=True) as bars:
        bars.add_task(doing, total=None)
        yield


def _bars(*columns: ProgressColumn, auto_refresh: bool) -> Bars:
    from rich.console import Console
    from rich.progress import Progress as Bars

    console = Console(file=cast("IO[str]", _Terminal()))
    return Bars(*columns, console=console, transient=True, auto_refresh=auto_refresh)


_FORECAST_FROM = 0.02
"""The fraction of the work after which the remaining time is shown."""


@contextmanager
def live_progress(quiet: bool) -> Iterator[Progress]:
    """Yield a callback that shows the progress of a run; it does nothing if quiet or stderr is not a terminal."""
    with progress_bar("opening the bench", quiet) as draw:
        if draw is None:
            yield no_progress
            return

        def show(moment: Moment) -> None:
            draw(
                f"step {moment.index}/{moment.count} {moment.label}, {moment.doing}",
                (moment.index - 1) / moment.count,
                f"set {moment.setpoint_c:+.1f} °C, air {_known(moment.air_c, '+.1f')}, "
                f"gyro {_known(moment.gyro_c, '+.2f')}, "
                f"{moment.rate_dps:+.1f} deg/s, {moment.samples:,} samples, {duration(moment.left_s)} left",
            )

        yield show


@contextmanager
def search_progress(quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """Yield a callback for a search, called with the current trial and the completed fraction (0 to 1).

    Yields None if quiet or stderr is not a terminal.
    """
    with progress_bar("reading", quiet) as draw:
        if draw is None:
            yield None
            return
        began_s = time.monotonic()

        def show(trying: str, done: float) -> None:
            left_s = (time.monotonic() - began_s) * (1 - done) / done if done > _FORECAST_FROM else math.nan
            draw(trying, done, f"{duration(left_s)} left" if math.isfinite(left_s) else "")

        yield show


def _known(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "not known yet"
