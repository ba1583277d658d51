"""The LabJack T7's spontaneous stream: packets of 16-bit samples, sent to any client on TCP port 702.

    | transaction 2 | protocol = 0, 2 | length 2 | unit = 1, 1 | function = 76, 1 | type = 16, 1 | reserved 1 |
    | backlog 2 | status 2 | additional 2 | sample 2 | sample 2 | ...                        up to 512 samples |

Numbers are big-endian; `length` counts the bytes after it. The transaction number increases by one from packet to
packet and wraps; a jump means lost packets. `backlog` is the number of bytes still buffered in the instrument. `status`
is 0 or one of `STATUS_WORDS`; with 2941 `additional` is the number of scans that were skipped while the instrument's
buffer was full.

Source: LabJack T-series datasheet 3.2.4 (low-level streaming); LabJack's public C example (backlog, dummy samples). Not
tried on hardware. Assumptions without a source:

* The samples of all scans follow each other without a break: a packet may start within a scan.
* The first packet of a stream may carry any transaction number; a lost packet held as many samples as the next one.
* A packet is only truncated by the end of its connection.
* A packet with status 2941 contains one dummy scan of only FFFFh in place of the missing scans, and it is counted among
  them (U3 datasheet, 5.2.12). A scan with an analog input never equals it: analog inputs never read FFFFh.

Accepted input: packets split or joined anywhere, lost packets, a full buffer, and junk directly before a packet; other
bytes raise `NotAPacketError`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl_instruments.errors import InstrumentError, LinkError

FUNCTION, PACKET_TYPE, UNIT = 76, 16, 1
MOST_SAMPLES = 512
HEADER_BYTES = 16
UNCOUNTED_BYTES = 6  # bytes of the header up to and including the length
DUMMY = 0xFFFF
SIGNATURE = bytes([UNIT, FUNCTION, PACKET_TYPE])  # of a packet, after its length

AUTO_RECOVER_ACTIVE, AUTO_RECOVER_END, SCAN_OVERLAP, SKIP_OVERFLOW, BURST_COMPLETE = 2940, 2941, 2942, 2943, 2944
STATUS_WORDS = {
    AUTO_RECOVER_ACTIVE: "its buffer is full and scans are being skipped",
    AUTO_RECOVER_END: "scans were skipped while its buffer was full",
    SCAN_OVERLAP: "a scan began before the one before it had ended; ask for a lower rate",
    SKIP_OVERFLOW: "its buffer was full for so long that it lost count of the skipped scans: read faster",
    BURST_COMPLETE: "the burst is complete",
}
_AT_ONCE = 256
"""Largest number of packets parsed together; limits the copying of later packets if all have different lengths."""
HARMLESS = (0, AUTO_RECOVER_ACTIVE, AUTO_RECOVER_END)

SampleArray = npt.NDArray[np.uint16]


class NotAPacketError(LinkError):
    """The stream contained bytes that are no packet, and no packet after them."""


def packet_type(samples: int) -> np.dtype[np.void]:
    """Return the layout of a packet with `samples` samples."""
    return np.dtype(
        [
            ("transaction", ">u2"),
            ("protocol", ">u2"),
            ("length", ">u2"),
            ("unit", "u1"),
            ("function", "u1"),
            ("type", "u1"),
            ("reserved", "u1"),
            ("backlog", ">u2"),
            ("status", ">u2"),
            ("additional", ">u2"),
            ("samples", ">u2", (samples,)),
        ]
    )


def encode_packets(
    samples: npt.NDArray[Any],
    *,
    first_transaction: int,
    backlog_bytes: npt.ArrayLike = 0,
    status: npt.ArrayLike = 0,
    additional: npt.ArrayLike = 0,
) -> bytes:
    """Return packets, one per row of `samples`, shape (packets, samples per packet).

    The other fields are one value for all or one per packet. A backlog above 65535 bytes is sent as 65535.
    """
    count, width = samples.shape
    packets = np.zeros(count, packet_type(width))
    packets["transaction"] = (first_transaction + np.arange(count)) & 0xFFFF
    packets["length"] = HEADER_BYTES - UNCOUNTED_BYTES + 2 * width
    packets["unit"], packets["function"], packets["type"] = UNIT, FUNCTION, PACKET_TYPE
    packets["backlog"] = np.minimum(backlog_bytes, 0xFFFF)
    packets["status"] = status
    packets["additional"] = additional
    packets["samples"] = samples
    return packets.tobytes()


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanRun:
    """Complete consecutive scans without a gap; `samples` has shape (scans, scan length).

    `first_index` counts scans from the start of the stream, including missing ones.
    """

    first_index: int
    samples: SampleArray

    @property
    def next_index(self) -> int:
        """The index of the next scan after this run if none is skipped."""
        return self.first_index + len(self.samples)


class StreamReader:
    """Extract scans from the bytes of one stream.

    Parameters
    ----------
    scan_length
        Samples per scan: the length of the scan list.

    Attributes
    ----------
    lost_packets, skipped_scans
        Number of missing packets, and number of scans that the instrument reports as skipped.
    junk_bytes
        Number of bytes that belonged to no packet.
    backlog_scans
        Number of scans buffered in the instrument when it sent the latest packet.
    """

    def __init__(self, scan_length: int) -> None:
        self.lost_packets = 0
        self.skipped_scans = 0
        self.junk_bytes = 0
        self.backlog_scans = 0
        self._scan_length = scan_length
        self._bytes = bytearray()
        self._next_transaction: int | None = None
        self._position = 0  # of the next sample, counted from the start of the stream, including missing ones
        # The samples of an unfinished scan, those just before `_position`.
        self._partial: SampleArray = np.empty(0, np.uint16)
        # Number of skipped scans, and the position by which the dummy scan must have appeared.
        self._dummy_due: tuple[int, int] | None = None

    def feed(self, data: bytes) -> list[ScanRun]:
        """Add received bytes and return the runs of scans that they complete, oldest first.

        Raises `NotAPacketError` for bytes that are no packet, `InstrumentError` for a status that ends the stream.
        """
        self._bytes += data
        runs: list[ScanRun] = []
        while (packets := self._sound_packets(after=runs)) is not None:
            for unbroken in self._split_where_lost(packets):
                runs += self._scans(unbroken)
        return runs

    def resume(self) -> None:
        """Continue with bytes of a new connection, which begin with a complete packet; missing packets count as lost.

        Raises `LinkError` before the first packet: the numbers may begin anywhere, so the loss would be unknown.
        """
        if self._next_transaction is None:
            raise LinkError("the stream broke before its first packet, so the times of all others are not known")
        self._bytes.clear()

    def _sound_packets(self, after: list[ScanRun]) -> npt.NDArray[np.void] | None:
        """Return equal packets after skipping junk; raise for junk without a packet only if `after` is empty."""
        while True:
            try:
                return self._take_equal_packets()
            except NotAPacketError:
                if not self._skip_junk():
                    if after:
                        return None
                    raise

    def _skip_junk(self) -> bool:
        """Skip to the next place where a packet may begin; return whether there is one."""
        place = self._bytes.find(SIGNATURE, UNCOUNTED_BYTES + 1)
        if place < 0:
            return False
        del self._bytes[: place - UNCOUNTED_BYTES]
        self.junk_bytes += place - UNCOUNTED_BYTES
        return True

    def _take_equal_packets(self) -> npt.NDArray[np.void] | None:
        """Return the complete packets of equal length at the front, or None."""
        if len(self._bytes) < HEADER_BYTES:
            return None
        length = int.from_bytes(self._bytes[4:6], "big")
        samples = (length + UNCOUNTED_BYTES - HEADER_BYTES) // 2
        if self._bytes[2:4] != b"\0\0" or length % 2 or not 1 <= samples <= MOST_SAMPLES:
            raise NotAPacketError(self._no_packet())
        layout = packet_type(samples)
        count = min(len(self._bytes) // layout.itemsize, _AT_ONCE)
        if not count:
            return None
        packets = np.frombuffer(self._bytes, layout, count=count).copy()
        good = (packets["protocol"] == 0) & (packets["function"] == FUNCTION) & (packets["type"] == PACKET_TYPE)
        if not good[0]:
            raise NotAPacketError(self._no_packet())
        equal = good & (packets["length"] == length)
        if not equal.all():
            packets = packets[: int(np.argmin(equal))]
        del self._bytes[: packets.nbytes]
        return packets

    def _no_packet(self) -> str:
        head = bytes(self._bytes[:HEADER_BYTES]).hex(" ")
        return f"the stream brought {head}, expected a packet of function {FUNCTION}, type {PACKET_TYPE}; start it anew"

    def _split_where_lost(self, packets: npt.NDArray[np.void]) -> list[npt.NDArray[np.void]]:
        """Split packets at jumps of the transaction number and around each end of a recovery."""
        transactions = packets["transaction"].astype(np.int64)
        jumps = (np.diff(transactions) & 0xFFFF) != 1
        recovered = packets["status"] == AUTO_RECOVER_END
        cuts = np.flatnonzero(jumps | recovered[1:] | recovered[:-1]) + 1
        return np.split(packets, cuts) if len(cuts) else [packets]

    def _scans(self, packets: npt.NDArray[np.void]) -> list[ScanRun]:
        """Return the runs in consecutive packets; a packet that ends a recovery is passed alone."""
        self._account_for_lost(packets)
        self._check_status(packets)
        self.backlog_scans = int(packets["backlog"][-1]) // (2 * self._scan_length)
        start = self._position - len(self._partial)
        samples = np.concatenate((self._partial, packets["samples"].reshape(-1)), dtype=np.uint16)
        self._position += packets["samples"].size
        if packets["status"][0] == AUTO_RECOVER_END:
            self._dummy_due = int(packets["additional"][0]), self._position + self._scan_length

        torn = -start % self._scan_length  # the rest of a scan whose beginning was lost
        samples, start = samples[torn:], start + torn
        complete = len(samples) // self._scan_length * self._scan_length
        self._partial = samples[complete:]
        run = ScanRun(first_index=start // self._scan_length, samples=samples[:complete].reshape(-1, self._scan_length))
        return [run for run in self._open_gap(run) if len(run.samples)]

    def _open_gap(self, run: ScanRun) -> list[ScanRun]:
        """Split the run at the expected dummy scan, if present; later scans are shifted by the skipped ones."""
        if self._dummy_due is None:
            return [run]
        skipped, latest = self._dummy_due
        dummies = np.flatnonzero((run.samples == DUMMY).all(axis=1))
        if not len(dummies):
            if self._position >= latest:
                raise InstrumentError(
                    f"the stream skipped {skipped} scans, expected a dummy scan in their place, none came: "
                    "the times of what follows are unknown; start it anew"
                )
            return [run]
        self._dummy_due = None
        dummy = int(dummies[0])
        missing = max(skipped, 1)  # the dummy itself is one of them
        self.skipped_scans += missing
        self._position += (missing - 1) * self._scan_length
        return [
            ScanRun(first_index=run.first_index, samples=run.samples[:dummy]),
            ScanRun(first_index=run.first_index + dummy + missing, samples=run.samples[dummy + 1 :]),
        ]

    def _account_for_lost(self, packets: npt.NDArray[np.void]) -> None:
        """Advance the position by the samples of lost packets, and drop the interrupted scan."""
        transaction = int(packets["transaction"][0])
        lost = 0 if self._next_transaction is None else (transaction - self._next_transaction) & 0xFFFF
        self._next_transaction = (int(packets["transaction"][-1]) + 1) & 0xFFFF
        if lost:
            self.lost_packets += lost
            self._position += lost * packets["samples"].shape[1]
            self._partial = self._partial[:0]

    def _check_status(self, packets: npt.NDArray[np.void]) -> None:
        bad = packets["status"][~np.isin(packets["status"], HARMLESS)]
        if len(bad):
            status = int(bad[0])
            words = STATUS_WORDS.get(status, "an unknown status")
            raise InstrumentError(f"the stream ended with status {status}: {words}")
