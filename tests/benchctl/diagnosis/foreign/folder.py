"""A made recording in memory as `benchctl` opens it, or as the folder that the other lab hands over."""

from __future__ import annotations

import gzip
import json
import tempfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.recordings.import_open import read_description
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.reader import Recording
from benchctl.recordings.step_entries import cut_into_steps
from benchctl.recordings.stored import StoredStep, stored_of
from tests.benchctl.diagnosis.foreign.linear import FloatArray
from tests.benchctl.diagnosis.foreign.make import COLUMNS, DECIMALS, SUPPLY
from tests.benchctl.diagnosis.foreign.truth import Truth


@dataclass(frozen=True, slots=True)
class _InMemory:
    """Steps that are all in memory; the source of a `Recording`."""

    steps: Mapping[int, Step]

    def channels(self, index: int) -> tuple[str, ...]:
        return tuple(self.steps[index].channels)

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        step = self.steps[info.index]
        if names is None:
            return step
        return Step(step.info, {name: values for name, values in step.channels.items() if name in names})

    def stored(self, info: StepInfo) -> StoredStep:
        return stored_of(self.load(info))

    def close(self) -> None:
        pass


def to_recording(description: dict[str, Any], table: FloatArray) -> Recording:
    """The recording as `open_recording` gives it, without the way through a file of samples."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _describe(folder, description)
        said = read_description(folder)
    names = _names(table)
    steps = cut_into_steps(
        said.steps,
        {name: table[:, k].copy() for k, name in enumerate(names)},
        rate_hz=said.bench.sample_rate_hz,
        where=lambda k: f"steps[{k}]",
    )
    meta = Meta(
        status="imported",
        unit=said.unit,
        bench=said.bench,
        simulation=said.simulation,
        extra={"csv_columns": list(names), "csv_decimals": {name: DECIMALS[name] for name in names}},
    )
    source = _InMemory({step.info.index: step for step in steps})
    return Recording(Path("made"), meta, [step.info for step in steps], source)


def write(folder: Path, description: dict[str, Any], table: FloatArray, truth: Truth) -> None:
    """The open recording as a folder, with what it conceals in `truth.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    _describe(folder, description)
    row = ",".join(f"%.{DECIMALS[name]}f" for name in _names(table)) + "\n"
    rows = [",".join(_names(table)) + "\n", *(row % tuple(values) for values in table.tolist())]
    with gzip.open(folder / "samples.csv.gz", "wt", compresslevel=3, encoding="ascii", newline="") as file:
        file.writelines(rows)
    (folder / "truth.json").write_text(json.dumps(truth.as_json(), indent=1), encoding="utf-8")


def _names(table: FloatArray) -> tuple[str, ...]:
    """The names of the columns of `table`."""
    return (*COLUMNS, SUPPLY)[: table.shape[1]]


def _describe(folder: Path, description: dict[str, Any]) -> None:
    (folder / "recording.json").write_text(json.dumps(description, indent=1), encoding="utf-8")
