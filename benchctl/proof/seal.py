"""Draw a trial's truth, seal it with a digest, and record the bench that obeys it.

    python -m benchctl.proof.seal --seed 1 --index 7 --class single --out FOLDER

prints the digest before anything is recorded, then how the recording went and which hypotheses of effects the diagnosis
must not have, each as a line of JSON. It leaves only the recording, which does not reveal the truth: neither its
provenance nor its journal contains the physics.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.campaign.stop import stop_on_signals
from benchctl.proof.draw import plan_of
from benchctl.proof.part_trials import PartTruth, drawn
from benchctl.proof.truth import Truth
from benchctl_instruments.errors import BenchError


def record(truth: Truth, folder: Path) -> Outcome:
    """Run the sealed bench through its wires; the recording is described by the bench as its lab knows it."""
    with stop_on_signals() as stop, open_bench(truth.sealed_bench()) as opened:
        described = replace(opened, bench=truth.unit.public_bench())
        outcome = run_campaign(plan_of(truth.unit), described, folder, stop=stop)
    if outcome.error is not None:
        raise outcome.error
    return outcome


def main(arguments: list[str] | None = None) -> int:
    """Run the process and return its exit status, that of a command of the suite."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--index", type=int, required=True)
    parser.add_argument("--class", dest="kind", required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    began_s = time.monotonic()
    try:
        truth = drawn(options.seed, options.index, options.kind)
        _tell({"digest": truth.digest()})
        if isinstance(truth, PartTruth):
            recording, rows = truth.record(options.out)
        else:
            outcome = record(truth, options.out)
            recording, rows = outcome.recording, outcome.samples
    except BenchError as err:
        sys.stderr.write(f"{err}\n")
        return err.exit_status
    _tell(
        {
            "recording": str(recording),
            "rows": rows,
            "without": list(truth.withheld),
            "wall_s": time.monotonic() - began_s,
        }
    )
    return 0


def _tell(line: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
