"""Diagnose the real recordings and print the table of `results/diagnosis.md`: `python -m tests.real [NAME …]`.

Each recording is diagnosed without a model file; the table also shows an expert's quick fit.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchctl.diagnosis import diagnose
from benchctl.diagnosis.result import Diagnosis, Finding, Part
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import join, open_recording
from benchctl.reports import diagnosis_words as words
from benchctl_instruments.errors import BenchError
from tests.shared import SHARED

MAPS = Path(__file__).parents[1] / "benchctl" / "recordings" / "maps"


@dataclass(frozen=True, slots=True)
class Case:
    """Files of one instrument (below `data/`), diagnosed jointly, and what an expert's quick fit found in them."""

    name: str
    files: tuple[str, ...]
    map: str
    expert: str
    part: Part = "gyro"
    axis: str = "z"


OVEN, COLD = "thermal/2024-", "thermal/"
CASES = (
    Case(
        "VG910 to ±400 °/s",
        ("vg910/unit1_static_points_to_400.csv",),
        "",
        "sine, S = 0.00428; overload from 240 °/s; 0.18 V",
    ),
    Case("VG910 to ±200 °/s", ("vg910/unit1_static_points.csv",), "", "sine, S = 0.00428"),
    Case("CRS03", ("vg910/crs03_static_points.csv",), "", "rails at 0.136 and 5.135 V; 1.8 mV"),
    *(
        Case(f"UIUC {name}", (f"uiuc_encoder_imu/raw_{name}.mat",), "uiuc", f"delay {delay}", axis=axis)
        for name, delay, axis in (
            ("pitch_slow", "12.06 ms, no low-pass", "y"),
            ("roll_slow", "12.1 ms", "x"),
            ("yaw_slow", "12.1 ms, scale 1.0060", "z"),
            ("yaw_medium", "12.1 ms, scale 1.0060", "z"),
        )
    ),
    Case(
        "servo_mount, both",
        ("servo_mount/10_22_1.dat", "servo_mount/10_22_4.dat"),
        "servo_mount",
        "delay 6.5 ms, gain 1.10 at 7 Hz; 6.3 °/s",
    ),
    Case(
        "motor bench, + with −",
        ("table_drive/idf_pos_0.065_1.mat", "table_drive/idf_neg_0.045_1.mat"),
        "drive",
        "Coulomb 35, offset 5.6 to 8.2 mN·m; 3 mN·m",
        "drive",
    ),
    Case(
        "motor bench, one run",
        ("table_drive/idf_pos_0.065_1.mat",),
        "drive",
        "the two cannot be told apart: turn the other way",
        "drive",
    ),
    Case("pendulum", ("pendulum/servo_pendulum.csv",), "pendulum", "gravity; 65 counts", "drive"),
    Case(
        "oven, step of 100 %",
        (f"{OVEN}08-03__signals_step_100_percent_door_closed.log",),
        "oven_step",
        "dead time 16 s, lag 28 s; 2.8 K",
        "chamber",
    ),
    Case(
        "oven, December profile",
        (f"{OVEN}12-08__signals_controlled_adjusted_profile.log",),
        "oven_profile",
        "spikes; door opened at the peak; 5.2 K",
        "chamber",
    ),
    *(
        Case(
            f"cold finger, {which}",
            tuple(f"{COLD}{name}.csv" for name in names),
            "cold_finger",
            "exchange, heat store; 0.15 K",
            "chamber",
        )
        for which, names in (
            ("both", ("cooldown_20130419_13.24.44", "warmup_20130419_13.58.50")),
            ("cooldown", ("cooldown_20130419_13.24.44",)),
            ("warmup", ("warmup_20130419_13.58.50",)),
        )
    ),
    Case("TCLab", ("thermal/tclab_step.csv",), "tclab", "second lag 25 to 32 s; 0.17 K", "chamber"),
)


def main(names: Sequence[str]) -> int:
    """Print a row each; 0 where all could be diagnosed."""
    _tell("| recording | findings | held out, rms | beside an expert's quick fit | s |\n|---|---|---|---|---|")
    failed = 0
    for case in CASES:
        if names and not any(name in case.name for name in names):
            continue
        began_s = time.monotonic()
        try:
            said = " | ".join(_row(diagnosed(case)))
        except BenchError as err:
            failed, said = 1, f"{err} | |"
        _tell(f"| {case.name} | {said} | {case.expert} | {time.monotonic() - began_s:.0f} |")
    return failed


def diagnosed(case: Case) -> Diagnosis:
    """The diagnosis of a case's files, imported anew."""
    with tempfile.TemporaryDirectory() as folder:
        mapping = None
        if case.map:
            mapping = Path(folder) / "map.toml"
            text = (MAPS / f"{case.map}.toml").read_text(encoding="utf-8")
            mapping.write_text(text.replace("all_gyro_2_z", f"all_gyro_2_{case.axis}"), encoding="utf-8")
        recordings = []
        for number, file in enumerate(case.files):
            import_recording(SHARED / "data" / file, mapping, Path(folder) / f"{number}.h5")
            recordings.append(open_recording(Path(folder) / f"{number}.h5"))
        try:
            return diagnose(join(recordings), part=case.part)
        finally:
            for recording in recordings:
                recording.close()


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _row(found: Diagnosis) -> Iterator[str]:
    unit = words.unit(found.fit.unit)
    told = "; ".join(_finding(one) for one in found.findings) or found.verdict
    yield told + (
        f"; unexplained along {', '.join(found.unexplained.coordinates)}" if found.unexplained.significant else ""
    )
    yield f"{words.size(found.fit.heldout_before, unit)} → {words.size(found.fit.heldout_after, unit)}"


def _finding(one: Finding) -> str:
    values = ", ".join(f"{name} {words.estimate(value)}" for name, value in one.parameters.items())
    others = " or ".join(other.effect.replace("_", " ") for other in one.alternatives if other.probability > 0.1)
    return f"{one.effect.replace('_', ' ')}{f' (or {others})' if others else ''}: {values}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
