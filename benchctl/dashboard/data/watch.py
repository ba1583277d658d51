"""What somebody who looks at a campaign that runs wants drawn."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Watch:
    """Channels over the last `window_s` seconds of the campaign's time, each in so many pixels."""

    channels: tuple[str, ...]
    window_s: float
    pixels: int
