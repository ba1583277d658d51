"""The faults of the line on which a digital gyro sends frames: an operation is a frame, `frame 17`, at its instant.

What becomes of a frame is told in `simulated.faults.frame_faults`. Frames are counted from 0 over all
streams, those that nobody heard left out.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from benchctl_instruments.simulated.faults.tables import FaultTable, Place

FrameKind = Literal[
    "frame_lost",
    "frame_cut",
    "frame_bad_checksum",
    "frame_junk_before",
    "frame_junk_in",
    "frame_junk_after",
    "frames_end",
]


class FrameFault(FaultTable):
    """A fault that befalls a frame."""

    places: ClassVar[tuple[Place, ...]] = ("gyro",)

    kind: FrameKind
