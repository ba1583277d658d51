"""Diagnose a recording blind: the process receives only the path of the recording.

    python -m benchctl.proof.blind RECORDING --arm physics --out FILE.json [--without EFFECT,EFFECT] [--part PART]

`--arm generic` runs the sparse regression instead of the diagnosis. The file holds the answer (`said`), the duration
including the opening of the recording (`seconds`) and the peak memory of the process (`peak_bytes`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchctl.diagnosis.result import Part
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import BenchError


def physics(path: Path, without: tuple[str, ...], part: Part = "gyro") -> dict[str, Any]:
    """Return the diagnosis of a part as JSON data, without the hypotheses of these effects."""
    from benchctl.diagnosis import diagnose

    with open_recording(path) as recording:
        return diagnose(recording, part=part, without=without).as_json()


def generic(path: Path) -> dict[str, Any]:
    """Return the result of the sparse regression."""
    from benchctl.proof.generic.arm import regress

    with open_recording(path) as recording:
        return asdict(regress(recording))


def main(arguments: list[str] | None = None) -> int:
    """Run the process and return its exit status, that of a command of the suite."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--arm", choices=("physics", "generic"), default="physics")
    parser.add_argument("--without", default="")
    parser.add_argument("--part", choices=("gyro", "drive", "chamber"), default="gyro")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    began_s = time.monotonic()
    try:
        if options.arm == "generic":
            answer = generic(options.recording)
        else:
            answer = physics(
                options.recording, tuple(name for name in options.without.split(",") if name), options.part
            )
    except BenchError as err:
        sys.stderr.write(f"{err}\n")
        return err.exit_status
    found = {"said": answer, "seconds": time.monotonic() - began_s, "peak_bytes": peak_bytes()}
    options.out.write_text(json.dumps(found), encoding="utf-8")
    return 0


def peak_bytes() -> int | None:
    """Return the peak memory of this process; None if the system does not report it."""
    if sys.platform == "win32":
        return None
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


if __name__ == "__main__":
    sys.exit(main())
