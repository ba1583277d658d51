"""What a driver and a controller said to each other, byte for byte."""

from __future__ import annotations

from benchctl_instruments.links.wirelog import WireEntry, WireLog


class Transcript:
    """Collects what goes over a link: `lines` are "> 01 03 ..." for what was sent and "< 01 03 ..." for the answers."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.log = WireLog(sink=self._take)

    def _take(self, entry: WireEntry) -> None:
        if entry.direction == "note" or not entry.data:
            return
        mark = ">" if entry.direction == "sent" else "<"
        text = entry.data.hex(" ").upper()
        if mark == "<" and self.lines and self.lines[-1].startswith("<"):  # an answer may come in pieces
            self.lines[-1] += f" {text}"
        else:
            self.lines.append(f"{mark} {text}")
