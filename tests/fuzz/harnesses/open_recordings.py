"""Open recordings: `recording.json`, a separator, and the bytes of `samples.csv`."""

from __future__ import annotations

import json
import shutil

from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.recordings.open_folder import HEADER, description, rows
from tests.fuzz.harness import Harness, refusals, workplace

_SEPARATOR = b"\n====\n"


def one_input(data: bytes) -> None:
    said, _, samples = data.partition(_SEPARATOR)
    folder = workplace() / "open"
    folder.mkdir(exist_ok=True)
    (folder / "recording.json").write_bytes(said)
    (folder / "samples.csv").write_bytes(samples)
    with refusals(), open_recording(folder) as recording:
        write_recording(workplace() / "made.h5", recording.meta, recording.steps())
    shutil.rmtree(folder)


def seeds() -> list[bytes]:
    samples = "\n".join([HEADER, *rows()]).encode() + b"\n"
    further = json.dumps(description(note={"a": [1]}, drive={"inertia_kg_m2": 1.0})).encode()
    return [
        json.dumps(description()).encode() + _SEPARATOR + samples,
        further
        + _SEPARATOR
        + samples.replace(b"chamber_temp_c", b"chamber_temp_c,supply_v").replace(b"23.00", b"23.00,5"),
    ]


HARNESS = Harness(
    name="open_recordings",
    weight=80,
    one_input=one_input,
    seeds=seeds,
    tokens=(_SEPARATOR, b'"kind": ', b'"steps": [', b"NaN", b"-Infinity", b"1e400", b"\\ud800", b"[" * 40, b"poll_x"),
    longest=8192,
)
