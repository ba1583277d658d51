"""A stream of blocks into a compressed, sealed step, beside h5py that is given the whole array at once.

Ours is timed from the first block appended: uncompressed into the file that a crash leaves readable, then compressed,
digested, synced to the disk and renamed; and once more until `recording.h5` is there, into which the step's file was
copied and all of whose samples were read back and held against their digests. h5py's is the call of `create_dataset`
for each channel, with the same filters and chunks, and closing the file: nothing is digested or synced.

Then a stream as fast as a digitizer might send: a million scans of four channels a second, for a minute, each block
handed over when it is due. What is read back must have the digest of what was sent.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.digests import SampleDigest, digest_of
from benchctl.recordings.reader import open_recording
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.recordings import made
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.peers import h5py_by_hand
from tests.benchmarks.peers.points import NAMES

SCANS = 4_000_000
BLOCK = 10_000
SAMPLES_A_SECOND = 4e6
OF_ITS_SPEED = 0.8
_PACE_HZ = 1.02 * SAMPLES_A_SECOND / len(NAMES)
"""Scans that are offered: a little more than are asked for, so that the last block may take its time."""
LIMIT_BEHIND_S = 0.5
_TURNS, _MINUTE_S = 5, 60.0

Block = dict[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Streamed:
    """Of a paced stream: samples a second from its first block until the last was in the file, and until it was sealed.

    `behind_s` is the latest that a block was taken after it was due.
    """

    in_file: float
    sealed: float
    behind_s: float


def measured() -> list[Comparison]:
    """The speed of ours beside that of h5py, the sizes of both, and the minute."""
    channels = signal(SCANS)
    pairs = [(_ours(channels), _theirs(channels)) for _ in range(_TURNS)]
    sealed, kept, size = (statistics.median(ours[column] for ours, _ in pairs) for column in range(3))
    speed, their_size = (statistics.median(theirs[column] for _, theirs in pairs) for column in range(2))
    peer, unit = "h5py, at once", "samples a second"
    minute = sustained(_MINUTE_S)
    return [
        Comparison("blocks to a sealed step", sealed, unit, peer, speed, ">=", OF_ITS_SPEED),
        Comparison("blocks to recording.h5, read back", kept, unit, peer, speed, ">=", OF_ITS_SPEED),
        Comparison("size of the compressed file", size, "bytes", peer, their_size, "<=", 1.0),
        Comparison("a minute's stream, in its file", minute.in_file, unit, "asked for", SAMPLES_A_SECOND, ">=", 1.0),
        Comparison("a minute's stream, behind its pace", minute.behind_s, "s", "limit", LIMIT_BEHIND_S, "<=", 1.0),
        Comparison("a minute's stream, sealed", minute.sealed, unit, "asked for", SAMPLES_A_SECOND, ">=", OF_ITS_SPEED),
    ]


def sustained(seconds: float) -> Streamed:
    """Stream at the pace; raises `RuntimeError` where what is read back is not what was sent."""
    blocks = round(seconds * _PACE_HZ / BLOCK)
    one_second = signal(100 * BLOCK)
    sent = {name: SampleDigest(blocks * BLOCK) for name in NAMES}
    behind_s = 0.0
    with tempfile.TemporaryDirectory() as folder:
        writer = CampaignWriter(Path(folder) / "campaign", made.meta(status="running"))
        step = writer.begin_step(made.info(1), NAMES)
        began_s = time.perf_counter()
        for number in range(blocks):
            block = _part(one_second, number)
            for name, samples in block.items():
                sent[name].update(samples)
            due_s = began_s + (number + 1) * BLOCK / _PACE_HZ
            time.sleep(max(0.0, due_s - time.perf_counter()))
            step.append(block)
            behind_s = max(behind_s, time.perf_counter() - due_s)
        step.flush()
        in_file_s = time.perf_counter() - began_s
        step.close(made.info(1))
        sealed_s = time.perf_counter() - began_s
        with open_recording(writer.finish("complete")) as recording:
            for name, digest in sent.items():
                if digest_of(recording.step(1, [name])[name]) != digest.hexdigest():
                    raise RuntimeError(f"{name}: what is read back is not what was sent")
    samples = blocks * BLOCK * len(NAMES)
    return Streamed(in_file=samples / in_file_s, sealed=samples / sealed_s, behind_s=behind_s)


def signal(scans: int) -> Block:
    """What a bench sends: a table that turns, 16 bits of a noisy gyro, a thermistor in steps of 0.1 mK."""
    chance, time_s = np.random.default_rng(1), np.arange(scans) / 1e6
    volts_a_step = 20.0 / 2**16
    return {
        "time_s": time_s,
        "encoder_deg": np.mod(np.round(50.0 * time_s * 1e5 / 360.0) * 360.0 / 1e5, 360.0),
        "gyro_v": np.round((0.5 + 1e-3 * chance.standard_normal(scans)) / volts_a_step) * volts_a_step,
        "gyro_temp_c": np.round((25.0 + 1e-3 * chance.standard_normal(scans)) / 1e-4) * 1e-4,
    }


def _part(channels: Block, number: int) -> Block:
    """The numbered block of a signal that begins again at its end, but for its stamps."""
    start = number * BLOCK % len(channels["time_s"])
    block = {name: samples[start : start + BLOCK] for name, samples in channels.items()}
    return block | {"time_s": (number * BLOCK + np.arange(BLOCK)) / 1e6}


def _ours(channels: Block) -> tuple[float, float, float]:
    """Samples a second until the step is sealed, and until the recording is there; its bytes."""
    samples = sum(map(len, channels.values()))
    with tempfile.TemporaryDirectory() as folder:
        writer = CampaignWriter(Path(folder) / "campaign", made.meta(status="running"))
        step = writer.begin_step(made.info(1), NAMES)
        began_s = time.perf_counter()
        for start in range(0, SCANS, BLOCK):
            step.append({name: of_it[start : start + BLOCK] for name, of_it in channels.items()})
        step.close(made.info(1))
        sealed_s = time.perf_counter() - began_s
        kept = writer.finish("complete")
        kept_s = time.perf_counter() - began_s
        with open_recording(kept) as recording:
            _require_same(channels, recording.step(1).channels)
        return samples / sealed_s, samples / kept_s, kept.stat().st_size


def _theirs(channels: Block) -> tuple[float, float]:
    """Samples a second, and bytes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "at_once.h5"
        spent_s = h5py_by_hand.write_at_once(channels, file)
        _require_same(channels, h5py_by_hand.read_back(file))
        return sum(map(len, channels.values())) / spent_s, file.stat().st_size


def _require_same(written: Mapping[str, FloatArray], read: Mapping[str, FloatArray]) -> None:
    if not all(np.array_equal(written[name], read[name]) for name in NAMES):
        raise RuntimeError("what is read back is not what was written: its speed means nothing")
