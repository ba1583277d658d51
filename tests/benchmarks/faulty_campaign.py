"""A campaign with a fault every 30 s of bench time, and without: `python -m tests.benchmarks.faulty_campaign`.

The faults take turns over the links and the stream, and all of them are such as the drivers get over. What is shown:
whether the campaign came to its end, how many faults there were and what of the data is missing, and where the
coefficients lie: within their intervals, and how far from those of the campaign without faults.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.bench import Bench, load_bench
from benchctl.calibration.calibrate import calibrate
from benchctl.campaign.opened import open_bench, world_settings
from benchctl.campaign.runner import run_campaign
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from benchctl_instruments.links.modbus import Retry
from benchctl_instruments.simulated.faults.link_faults import (
    Cut,
    HalfFloat,
    Junk,
    Late,
    OtherUnit,
    PulledCable,
    Silence,
    Split,
)
from benchctl_instruments.simulated.faults.schedule import FaultTable
from benchctl_instruments.simulated.faults.stream_faults import Overrun, StreamCut, StreamGap, StreamJunk
from tests.benchmarks.coverage import PARAMETERS

EVERY_S = 30.0
REPEATABLE = "^(?!:interlock:reset|:dem:delta)"  # what a driver may say twice
OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "rate_table": {"timeout_s": 0.2},
    "chamber": {"timeout_s": 0.2, "retry": Retry(wait_s=0.05)},
    "digitizer": {"timeout_s": 0.2},
}


def faults() -> list[FaultTable]:
    """Each happens in its turn, so that one is due every 30 s."""
    table: dict[str, Any] = {"on": "rate_table", "pattern": REPEATABLE}
    stream: dict[str, Any] = {"on": "digitizer_stream", "pattern": "packet [1-9]"}  # a lost first one ends the run
    turns: list[tuple[type[FaultTable], dict[str, Any]]] = [
        (Silence, table),
        (Silence, {"on": "chamber"}),
        (Cut, {"on": "digitizer"}),
        (StreamGap, stream),
        (Late, table),
        (OtherUnit, {"on": "chamber"}),
        (Overrun, stream),
        (Junk, {**table, "kind": "junk_before"}),
        (HalfFloat, {"on": "chamber"}),
        (Silence, {"on": "digitizer"}),
        (StreamCut, stream),
        (Cut, table),
        (Split, {"on": "chamber"}),
        (PulledCable, {"on": "chamber", "for_s": 0.1}),
        (StreamJunk, stream),
        (Cut, {"on": "chamber"}),
    ]
    cycle_s = EVERY_S * len(turns)
    return [
        kind(from_s=EVERY_S * place, every_s=cycle_s, **fields) for place, (kind, fields) in enumerate(turns, start=1)
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """What came of one: value, standard uncertainty and 95 % interval of each coefficient, and what happened."""

    status: str
    bench_s: float
    wall_s: float
    samples: int
    gaps: int
    fired: Mapping[str, int]
    recovered: int
    found: Mapping[str, tuple[float, float, tuple[float, float]]]
    error_percent: Mapping[str, float]


def campaign(bench: Bench) -> Campaign:
    """Run and fit the campaign of `tests.benchmarks.coverage`, over its wires."""
    with tempfile.TemporaryDirectory() as folder:
        with open_bench(bench) as opened:
            outcome = run_campaign(find_procedure("two_stage").expand(PARAMETERS), opened, Path(folder) / "c")
            fired = Counter(f"{one.where} {one.kind}" for one in opened.simulated.fired) if opened.simulated else {}
        if outcome.error is not None:
            raise SystemExit(f"the campaign ended early: {outcome.error}; after {dict(fired)}")
        with open_recording(outcome.recording) as recording:
            result = calibrate(recording.steps(), recording.meta)
            journal = str(recording.meta.provenance["journal"]).splitlines()
            gaps = sum(info.gaps for info in recording.infos)
    parameters = {name: result.best.parameter(name) for name in _truth(bench)}
    return Campaign(
        status=outcome.status,
        bench_s=outcome.bench_time_s,
        wall_s=outcome.wall_time_s,
        samples=outcome.samples,
        gaps=gaps,
        fired=dict(fired),
        recovered=sum(json.loads(line)["kind"] == "recovered" for line in journal),
        found={name: (found.value, found.standard, found.ci95) for name, found in parameters.items()},
        error_percent=dict(result.error_percent),
    )


def _truth(bench: Bench) -> dict[str, float]:
    gyro = world_settings(bench).gyro
    return {
        "K0_v_per_dps": gyro.K0_v_per_dps,
        "U0_v": gyro.U0_v,
        "S_rad_per_dps": gyro.S_rad_per_dps,
        "g1": gyro.g1_per_c,
        "g2": gyro.g2_per_c2,
        "c1": gyro.c1_v_per_c,
        "c2": gyro.c2_v_per_c2,
    }


def lines(bench: Bench, without: Campaign, with_faults: Campaign) -> list[str]:
    """Both campaigns as Markdown."""
    rows = [
        ("status", without.status, with_faults.status),
        ("bench time, wall time [s]", *(f"{each.bench_s:.0f}, {each.wall_s:.0f}" for each in (without, with_faults))),
        ("faults that happened", 0, sum(with_faults.fired.values())),
        ("events `recovered`", without.recovered, with_faults.recovered),
        ("gaps; scans missing", without.gaps, f"{with_faults.gaps}; {without.samples - with_faults.samples}"),
        *(
            (f"error_percent, {level}", *(f"{each.error_percent[level]:.4f}" for each in (without, with_faults)))
            for level in without.error_percent
        ),
    ]
    for name, true in _truth(bench).items():
        cells = []
        for each in (without, with_faults):
            value, standard, (low, high) = each.found[name]
            cells.append(f"z = {(value - true) / standard:+.2f}, {'held' if low <= true <= high else 'NOT held'}")
        rows.append((name, cells[0], cells[1]))
    shifts = [
        abs(with_faults.found[name][0] - without.found[name][0]) / without.found[name][1] for name in without.found
    ]
    rows.append(("largest shift, in standard uncertainties", "", f"{max(shifts):.2f}"))
    return [
        "| | without faults | with a fault every 30 s |",
        "|---|---|---|",
        *(f"| {name} | {left} | {right} |" for name, left, right in rows),
        "",
        *(f"- {kind}: {count}" for kind, count in sorted(with_faults.fired.items())),
    ]


def main() -> None:
    """Run both campaigns and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    plain = load_bench("simulated").with_seed(parser.parse_args().seed)
    bench = plain.model_copy(
        update={name: getattr(plain, name).model_copy(update={"options": options}) for name, options in OPTIONS.items()}
    )
    without = campaign(bench)
    with_faults = campaign(bench.model_copy(update={"faults": tuple(faults())}))
    for line in lines(bench, without, with_faults):
        sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main()
