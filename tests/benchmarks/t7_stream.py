"""The T7's driver at the T7's limit, in real time: `python -m tests.benchmarks.t7_stream --seconds 600`.

100,000 samples a second are 25,000 scans a second of this bench's four channels: the count's low word and high word,
the gyro's volts, the thermistor's volts. The simulated T7 is a process of its own, the driver is in this one, and
registers and stream go over loopback sockets. The volts come out of the whole chain of physics, with a table that
oscillates and a chamber that heats, so that hardly a scan is like the one before. Both sides digest every scan: the
scans that were taken are to be the scans that were sent, in their order. Ends with status 1 where one is lost.

Backlog is what the simulated T7 states. Where its own process comes late, that shows as backlog too, and nothing is
skipped for it; its buffer overflows only while the driver reads too slowly for the sockets between them.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import platform
import sys
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from multiprocessing.connection import Connection

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.digitizers.labjack_t7 import LabJackT7
from benchctl_instruments.digitizers.t7_registers import SCAN_LENGTH
from benchctl_instruments.errors import BenchError, LinkError
from benchctl_instruments.interfaces import ScanBlock
from benchctl_instruments.physics.adc import codes_from_volts
from benchctl_instruments.protocols.t7_stream import MOST_SAMPLES
from benchctl_instruments.simulated.clock import ScaledClock
from benchctl_instruments.simulated.faults.stream_faults import StreamFault
from benchctl_instruments.simulated.machines import AnalogInputs
from tests.benchmarks.machine import processor
from tests.benchmarks.memory import peak_bytes

SAMPLES_A_SECOND = 100_000
RATE_HZ = SAMPLES_A_SECOND / SCAN_LENGTH
SCANS_A_PACKET = MOST_SAMPLES // SCAN_LENGTH
SCANS_A_READ = 1280
MOST_BACKLOG_SCANS = 0xFFFF // (2 * SCAN_LENGTH)  # that a packet can state
RANGE_V = 10.0
TIMEOUT_S = 5.0
AMPLITUDE_DEG, FREQUENCY_HZ = 30.0, 0.5
WARM_C = 60.0


@dataclass(slots=True)
class Digest:
    """How many scans went by, and a checksum over all of them in their order."""

    scans: int = 0
    crc: int = 0

    def add(self, count: IntArray, gyro_v: FloatArray, thermistor_v: FloatArray) -> None:
        """Some more scans, each of the arrays of shape (scans,); of volts only the converter's code counts."""
        gyro, thermistor = (codes_from_volts(volts, range_v=RANGE_V) for volts in (gyro_v, thermistor_v))
        self.crc = zlib.crc32(np.stack([count, gyro, thermistor], axis=1).astype(np.int64).tobytes(), self.crc)
        self.scans += len(count)


class LimitedInputs:
    """Terminals where time stands still once a stream has had its scans, so that it is known to a scan what was sent.

    Parameters
    ----------
    inputs
        The terminals behind it.
    scans
        After how many of a stream; they are to fill whole packets, or the last ones stay in the instrument.
    """

    def __init__(self, inputs: AnalogInputs, scans: int) -> None:
        self.sent = Digest()
        self._inputs = inputs
        self._lasts_s = (scans - 0.5) / RATE_HZ
        self._end_s: float | None = None

    def now(self) -> float:
        """Bench time, no later than the last scan."""
        now_s = self._inputs.now()
        return now_s if self._end_s is None else min(now_s, self._end_s)

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """As `AnalogInputs`; what lies behind the last scan never comes."""
        if self._end_s is not None and bench_time_s > self._end_s:
            time.sleep(timeout_s)
            return False
        return self._inputs.wait_until(bench_time_s, timeout_s)

    def hold_history(self, since_s: float | None) -> None:
        """As `AnalogInputs`; the first instant to be held is that of the first scan."""
        if self._end_s is None and since_s is not None:
            self._end_s = since_s + self._lasts_s
        self._inputs.hold_history(since_s)

    def sample(
        self, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """As `AnalogInputs`, and digested."""
        samples = self._inputs.sample(first_s, interval_s, scans, start=start)
        self.sent.add(*samples)
        return samples


@dataclass(frozen=True, slots=True, kw_only=True)
class Served:
    """What the simulated T7 says of a run."""

    sent: Digest
    cpu_s: float
    peak_bytes: int | None


def serve(scans: int, faults: Sequence[StreamFault], talk: Connection) -> None:
    """A simulated T7 on a bench that moves: its addresses, and on being told that all is read what it did."""
    # Imported here, so that the reader's memory is the reader's own.
    from benchctl_instruments.simulated.faults.schedule import PendingFaults
    from benchctl_instruments.simulated.labjack_t7 import SimulatedLabJackT7
    from benchctl_instruments.simulated.world import World

    world = World(ScaledClock())
    world.table.close_loop()
    world.table.demand_sine(AMPLITUDE_DEG, FREQUENCY_HZ, 0.0, AMPLITUDE_DEG)
    world.chamber.set_setpoint(WARM_C)
    world.chamber.run(True)
    inputs = LimitedInputs(world.inputs, scans)
    twin = SimulatedLabJackT7(inputs)
    if faults:
        twin.stream_faults = PendingFaults("digitizer_stream", faults, [])
    with twin:
        began_cpu_s = time.process_time()
        talk.send((twin.address, twin.stream_address))
        talk.recv()
        talk.send(Served(sent=inputs.sent, cpu_s=time.process_time() - began_cpu_s, peak_bytes=peak_bytes()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What one run brought; `due` is how many scans there were to be, `ended_by` what broke it off, if anything did."""

    due: int
    wall_s: float
    taken: Digest
    gaps: int
    largest_backlog: int
    reader_cpu_s: float
    reader_peak_bytes: int | None
    served: Served
    ended_by: str

    @property
    def lost(self) -> int:
        """How many scans never came."""
        return self.due - self.taken.scans

    @property
    def sound(self) -> bool:
        """Whether every scan came, once, in its place and as it was sent."""
        return not self.lost and not self.gaps and not self.ended_by and self.taken == self.served.sent


def run(seconds: float, faults: Sequence[StreamFault] = ()) -> Run:
    """Stream for some seconds, from a simulated T7 whose packets suffer `faults`."""
    due = max(1, round(seconds * RATE_HZ / SCANS_A_PACKET)) * SCANS_A_PACKET
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    process = spawn.Process(target=serve, args=(due, faults, there), daemon=True)
    process.start()
    there.close()
    address, stream_address = here.recv()
    taken, expected, gaps, largest_backlog, ended_by = Digest(), 0, 0, 0, ""
    with LabJackT7(address, stream_address, clock=ScaledClock(), range_v=RANGE_V) as t7:
        t7.start_stream(RATE_HZ)
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        try:
            while expected < due:
                block = read(t7, min(SCANS_A_READ, due - expected))
                taken.add(block.encoder_count, block.gyro_v, block.thermistor_v)
                gaps += block.first_index != expected
                expected = block.first_index + len(block.gyro_v)
                largest_backlog = max(largest_backlog, block.backlog)
        except BenchError as err:
            ended_by = str(err)
        wall_s, cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
        here.send("all is read")
        served = here.recv()
    process.join()
    return Run(
        due=due,
        wall_s=wall_s,
        taken=taken,
        gaps=gaps,
        largest_backlog=largest_backlog,
        reader_cpu_s=cpu_s,
        reader_peak_bytes=peak_bytes(),
        served=served,
        ended_by=ended_by,
    )


def read(t7: LabJackT7, scans: int) -> ScanBlock:
    """So many scans, or the fewer that came in time."""
    try:
        return t7.read_stream(scans, TIMEOUT_S)
    except LinkError:
        return t7.read_stream(1, 0.0)


def table(result: Run) -> str:
    """A run as Markdown."""
    served = result.served
    rows = [
        (
            "asked for",
            f"{RATE_HZ:,.0f} scans a second of {SCAN_LENGTH} channels, {SAMPLES_A_SECOND:,} samples a second",
        ),
        (
            "came",
            f"{result.taken.scans * SCAN_LENGTH / result.wall_s:,.0f} samples a second, for {result.wall_s:.1f} s",
        ),
        ("scans due", f"{result.due:,}"),
        ("scans sent", f"{served.sent.scans:,}"),
        ("scans taken", f"{result.taken.scans:,}"),
        ("scans lost", f"{result.lost:,}"),
        ("gaps reported", f"{result.gaps:,}"),
        ("taken as they were sent, by checksum", "yes" if result.taken == served.sent else "no"),
        ("largest backlog", _backlog(result.largest_backlog)),
        ("reader", _cost(result.reader_cpu_s / result.wall_s, result.reader_peak_bytes)),
        ("simulated T7 and bench", _cost(served.cpu_s / result.wall_s, served.peak_bytes)),
        (
            "machine",
            f"{processor()}, {os.cpu_count()} CPUs, Python {platform.python_version()}, {platform.platform()}",
        ),
        ("date", f"{date.today():%Y-%m-%d}"),
    ]
    if result.ended_by:
        rows.append(("ended by", result.ended_by))
    return "\n".join(["| what | figure |", "|---|---|", *(f"| {what} | {figure} |" for what, figure in rows)])


def _backlog(scans: int) -> str:
    at_least = "at least " if scans >= MOST_BACKLOG_SCANS else ""
    return f"{at_least}{scans:,} scans, {1e3 * scans / RATE_HZ:.0f} ms"


def _cost(share: float, peak: int | None) -> str:
    memory = "an unknown amount of" if peak is None else f"{peak / 2**20:.0f} MiB of"
    return f"{share:.1%} of a processor, at most {memory} memory"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 where a scan is lost."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    result = run(parser.parse_args(arguments).seconds)
    print(table(result))  # noqa: T201
    return 0 if result.sound else 1


if __name__ == "__main__":
    sys.exit(main())
