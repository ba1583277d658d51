"""Draw an effect for a real recording, seal it, and write the recording with the effect added.

    python -m benchctl.proof.inject RECORDING --said UNTOUCHED.json --seed 1 --index 7 --out FILE.h5

prints the digest as JSON. `--said` is the diagnosis of the recording without the effect.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchctl.documents import read_json
from benchctl.proof.injection import Untouched
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import BenchError


def main(arguments: list[str] | None = None) -> int:
    """Run the process and return its exit status, that of a command of the suite."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--said", type=Path, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--index", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    try:
        with open_recording(options.recording) as recording:
            untouched = Untouched(recording, read_json(options.said, "diagnosis")["said"])
            injection = untouched.drawn(options.seed, options.index)
            sys.stdout.write(json.dumps({"digest": injection.digest()}) + "\n")
            write_recording(options.out, recording.meta, untouched.with_it(injection))
    except BenchError as err:
        sys.stderr.write(f"{err}\n")
        return err.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
