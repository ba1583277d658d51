"""Digital gyros at the limit of their lines: `python -m tests.benchmarks.gyro_frames [SECONDS]`.

The simulated gyro is a process of its own at the end of a pseudo-terminal and sends as many frames as its line could
carry. Of the frames between the first and the last one read: how many were kept and how many were lost, and which share
of a processor the reading took; then the same over a line that spoils one frame in a hundred and puts junk before one
in a hundred. At last, how much faster frames are found, checked and decoded than the line could bring them.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from benchctl_instruments.catalog import driver
from benchctl_instruments.physics.gyro import GyroParameters
from benchctl_instruments.physics.table import TableParameters
from benchctl_instruments.protocols import kvh1760 as kvh
from benchctl_instruments.protocols import stim300 as stim
from benchctl_instruments.protocols.frames import FrameReader
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.digital_gyro import DigitalGyro
from benchctl_instruments.simulated.kvh_dsp1760 import SimulatedKvhDsp1760
from benchctl_instruments.simulated.sensonor_stim300 import SimulatedStim300
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World

SETTINGS = WorldSettings(
    gyro=GyroParameters(arw_deg_per_sqrt_h=0.0, bias_walk_v_per_sqrt_s=0.0), table=TableParameters(ripple=0.0)
)
BAUDS = (1_000_000, 4_000_000)
SPOILT, AFTER_JUNK, LONGEST_JUNK = 0.01, 0.01, 100
STATED_RATE_HZ = 1000.0  # however fast the line lets it send
BITS_PER_BYTE = 10


class Hurried(DigitalGyro):
    """Sends as fast as its line can carry, which a real one does not."""

    def _begin_stream(self, rate_hz: float) -> None:
        super()._begin_stream(self._baud / (self.frame_bytes * BITS_PER_BYTE))


class HurriedKvhDsp1760(Hurried, SimulatedKvhDsp1760):
    """A DSP-1760 in a hurry."""


class HurriedStim300(Hurried, SimulatedStim300):
    """A STIM300 in a hurry."""


class BadLine:
    """Flips a bit in some frames, and puts junk before some."""

    def __init__(self, frame_bytes: int) -> None:
        self._frame_bytes = frame_bytes
        self._chance = np.random.default_rng(1)

    def __call__(self, data: bytes) -> bytes:
        if len(data) % self._frame_bytes:
            return data  # an answer
        pieces: list[bytes] = []
        for frame in np.frombuffer(data, np.uint8).reshape(-1, self._frame_bytes).copy():
            spoil, junk = self._chance.random(2)
            if spoil < SPOILT:
                frame[self._chance.integers(self._frame_bytes)] ^= 1 << self._chance.integers(8)
            if junk < AFTER_JUNK:
                pieces.append(self._chance.bytes(int(self._chance.integers(1, LONGEST_JUNK + 1))))
            pieces.append(frame.tobytes())
        return b"".join(pieces)


def serve(model: str, baud: int, bad_line: bool, talk: Connection) -> None:
    """A simulated gyro that turns evenly: its address, and on being told to stop what it did."""
    world = World(ScaledClock(), SETTINGS)
    world.table.close_loop()
    world.table.demand_rate(20.0)
    world.clock.sleep(2.0)  # by then it turns evenly
    gyro: DigitalGyro
    if model == "kvh_dsp1760":
        gyro = HurriedKvhDsp1760(world.inputs, SETTINGS, baud=baud)
    else:
        gyro = HurriedStim300(world.inputs, SETTINGS, rate_hz=STATED_RATE_HZ, baud=baud)
    if bad_line:
        gyro.line.disturb = BadLine(gyro.frame_bytes)
    with gyro:
        talk.send((gyro.address, gyro.frame_bytes))
        talk.recv()
        talk.send((gyro.line.dropped_bytes, time.process_time()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What one run brought."""

    rate_hz: float
    wall_s: float
    cpu_s: float
    kept: int
    lost: int
    dropped_bytes: int
    bad_frames: int
    junk_bytes: int
    strays: int

    def __str__(self) -> str:
        return (
            f"{self.kept + self.lost:,} frames sent in {self.wall_s:.1f} s ({self.rate_hz:,.0f} a second),"
            f" {self.kept:,} kept, {self.lost:,} lost ({self.lost / (self.kept + self.lost):.2%}),"
            f" {self.dropped_bytes:,} bytes dropped by the terminal;"
            f" {self.bad_frames:,} bad, {self.junk_bytes:,} bytes of junk, {self.strays} wrong samples taken;"
            f" reader {self.cpu_s / self.wall_s:.1%} of a processor"
        )


def run(model: str, baud: int, seconds: float, *, bad_line: bool) -> Run:
    """Read one gyro for some seconds."""
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    process = spawn.Process(target=serve, args=(model, baud, bad_line, there), daemon=True)
    process.start()
    address, frame_bytes = here.recv()
    rate_hz = float(baud // (frame_bytes * BITS_PER_BYTE))
    rates: list[Any] = []
    with driver("gyro", model)(address, clock=ScaledClock()) as gyro:
        gyro.start_stream(STATED_RATE_HZ)
        first = gyro.read_stream(1, 5.0)
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        while (wall_s := time.perf_counter() - began_s) < seconds:
            block = gyro.read_stream(int(rate_hz / 10), 5.0)
            rates.append(block.rate_dps)
        cpu_s = time.process_time() - began_cpu_s
    here.send("stop")
    dropped_bytes, _ = here.recv()
    process.join()
    found = np.concatenate(rates)
    return Run(
        rate_hz=rate_hz,
        wall_s=wall_s,
        cpu_s=cpu_s,
        kept=block.counts.samples - first.counts.samples,
        lost=block.counts.lost - first.counts.lost,
        dropped_bytes=dropped_bytes,
        bad_frames=block.counts.bad_frames,
        junk_bytes=block.counts.junk_bytes,
        strays=int((np.abs(found - np.median(found)) > 0.01).sum()),
    )


def decoding_bytes_per_s(model: str, piece: int) -> float:
    """How fast frames are found, checked and decoded, in pieces of some size."""
    turned = np.random.default_rng(2).normal(0.0, 30.0, (200_000, 3))
    numbers = np.arange(len(turned))
    if model == "kvh_dsp1760":
        data, frame = kvh.encode_frames(turned, 20, first_sequence=0), kvh.FORMAT
    else:
        steps = np.rint(turned / stim.RATE_STEP_DPS)
        data, frame = stim.encode_frames(0xA7, steps, counter=numbers), stim.frame_format(0xA7)
    reader, decoded = FrameReader([frame]), 0
    began_s = time.perf_counter()
    for at in range(0, len(data), piece):
        for found in reader.feed(data[at : at + piece]):
            if model == "kvh_dsp1760":
                decoded += len(kvh.decode_frames(found.rows).rotation)
            else:
                decoded += len(stim.decode_frames(0xA7, found.rows).gyro)
    took_s = time.perf_counter() - began_s
    if decoded != len(turned):
        raise SystemExit(f"{model}: {decoded} of {len(turned)} frames decoded")
    return len(data) / took_s


def main() -> None:
    """Print each figure."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    for model in ("kvh_dsp1760", "sensonor_stim300"):
        for baud in BAUDS:
            for bad_line in (False, True):
                line = "bad line" if bad_line else "good line"
                print(f"{model} at {baud / 1e6:g} Mbit/s, {line}: {run(model, baud, seconds, bad_line=bad_line)}")  # noqa: T201
        for piece in (1 << 12, 1 << 16):
            speed = decoding_bytes_per_s(model, piece)
            limit = BAUDS[-1] / BITS_PER_BYTE
            print(  # noqa: T201
                f"{model} decoded in pieces of {piece // 1024} KiB: {speed / 1e6:.0f} MB/s,"
                f" {speed / limit:.0f} times what {BAUDS[-1] / 1e6:g} Mbit/s bring"
            )


if __name__ == "__main__":
    main()
