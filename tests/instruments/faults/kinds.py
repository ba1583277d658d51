"""The faults of the matrix: one line each, and how each is made so that a busy machine sees it as a lab would."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from benchctl_instruments.simulated.faults.link_faults import (
    BadChecksum,
    Cut,
    HalfFloat,
    Junk,
    Late,
    LostRequest,
    OtherUnit,
    PulledCable,
    Refusal,
    Restart,
    Silence,
    Slow,
    Split,
    TableTrips,
)
from benchctl_instruments.simulated.faults.machines import (
    ClockDrift,
    EncoderJump,
    OverRange,
    StallsShort,
    StuckReading,
    VelocityTrip,
)
from benchctl_instruments.simulated.faults.schedule import FaultTable
from benchctl_instruments.simulated.faults.stream_faults import (
    FrameFault,
    Overrun,
    StreamCut,
    StreamEnds,
    StreamGap,
    StreamJunk,
    StreamStalls,
)

Make = Callable[..., FaultTable]

LINK: Mapping[str, Make] = {
    "silence": Silence,
    "lost request": LostRequest,
    "late answer": Late,
    "slow answer": lambda **when: Slow(delay_s=0.05, **when),
    "another unit's answer": OtherUnit,
    "CRC error": BadChecksum,
    "junk before": lambda **when: Junk(kind="junk_before", **when),
    "junk in": lambda **when: Junk(kind="junk_in", **when),
    "junk after": lambda **when: Junk(kind="junk_after", **when),
    "split": Split,
    "cut": Cut,
    "half a float": HalfFloat,
    "refusal": Refusal,
    "pulled cable, 0.1 s": lambda **when: PulledCable(for_s=0.1, **when),
    "restart, 0.1 s": lambda **when: Restart(for_s=0.1, **when),
}
"""Faults of a link; they befall a question and a command, in two dialogues."""

AT_S, SOAKED_TO_C = 8.0, 27.0
"""In the runs: bench time by which the table turns and the stream runs; where the chamber goes."""

MACHINE: Mapping[str, Mapping[str, Make]] = {
    "chamber": {
        "stuck reading": lambda **on: StuckReading(from_s=AT_S, **on),
        "over-range sensor": lambda **on: OverRange(from_s=AT_S, **on),
        "stalls short of the set point": lambda **on: StallsShort(pattern=f"set point {SOAKED_TO_C:g}", **on),
    },
    "rate_table": {
        "stuck reading": lambda **on: StuckReading(**on),
        "interlock opened by hand": lambda **on: TableTrips(kind="interlock_opened", from_s=AT_S, times=1, **on),
        "following error": lambda **on: TableTrips(kind="following_error", from_s=AT_S, times=1, **on),
        "velocity trip": lambda **on: VelocityTrip(from_s=AT_S, times=1, for_s=1.0, **on),
    },
    "digitizer": {
        "stuck reading": lambda **on: StuckReading(from_s=AT_S, **on),
        "over-range sensor": lambda **on: OverRange(from_s=AT_S, **on),
        "encoder jump": lambda **on: EncoderJump(from_s=AT_S, **on),
        "clock drift, 20 ppm": lambda **on: ClockDrift(**on),
    },
}
"""Faults of the machine behind an instrument; they befall a short campaign."""

STREAM: Mapping[str, Make] = {
    "stream gap": lambda **on: StreamGap(from_s=AT_S, times=1, **on),
    "overrun and auto-recovery": lambda **on: Overrun(from_s=AT_S, times=1, **on),
    "stream cut": lambda **on: StreamCut(from_s=AT_S, times=1, **on),
    "stream junk": lambda **on: StreamJunk(from_s=AT_S, times=1, **on),
    "stream stalls, 0.5 s": lambda **on: StreamStalls(from_s=AT_S, times=1, **on),
    "stream ends": lambda **on: StreamEnds(from_s=AT_S, times=1, **on),
}
"""Faults of a digitizer's stream; they befall a short campaign."""

FRAMES: Mapping[str, Make] = {
    "frame lost": lambda **on: FrameFault(kind="frame_lost", from_s=AT_S, times=1, **on),
    "frame cut": lambda **on: FrameFault(kind="frame_cut", from_s=AT_S, times=1, **on),
    "frame with a bad checksum": lambda **on: FrameFault(kind="frame_bad_checksum", from_s=AT_S, times=1, **on),
    "junk before a frame": lambda **on: FrameFault(kind="frame_junk_before", from_s=AT_S, times=1, **on),
    "junk in a frame": lambda **on: FrameFault(kind="frame_junk_in", from_s=AT_S, times=1, **on),
    "junk after a frame": lambda **on: FrameFault(kind="frame_junk_after", from_s=AT_S, times=1, **on),
    "frames end": lambda **on: FrameFault(kind="frames_end", from_s=AT_S, times=1, **on),
}
"""Faults of the line of a digital gyro; they befall a short campaign."""
