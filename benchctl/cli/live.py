"""How it goes, at the terminal: a campaign's step, temperatures, rate; a diagnosis' hypothesis; and the time left."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from benchctl.campaign.progress import Moment, Progress, nobody
from benchctl.cli.terminal import progress_bar
from benchctl.cli.words import duration

_FORECAST_FROM = 0.02
"""The share of the work after which the time left is told."""


@contextmanager
def live_progress(quiet: bool) -> Iterator[Progress]:
    """Somebody to tell how the run goes: a terminal where there is one, else nobody."""
    with progress_bar("opening the bench", quiet) as draw:
        if draw is None:
            yield nobody
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
    """Whom a search tells what it tries and which share, 0 to 1, is behind it; None where nobody would see it."""
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
