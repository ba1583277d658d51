"""Run the trials of a proof: one process seals and records, others answer blind, then the truth is unsealed.

Each finished trial is kept as a file; an interrupted proof resumes where it stopped. The truth is not on the disk
before it is unsealed: the recording process draws it, and this process draws it again once the answers exist, and
compares it with the digest.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from benchctl.atomic import disk_errors, whole_file
from benchctl.campaign.stop import StopRequest
from benchctl.diagnosis.result import Part
from benchctl.proof.classes import CLASSES, ClassName, allotted
from benchctl.proof.part_trials import drawn
from benchctl.proof.processes import ProcessFailedError, run_module
from benchctl.proof.score import Score, models_in, score_diagnosis, score_regression
from benchctl.proof.trial import Answer, Trial, read_trial, write_trial
from benchctl.proof.truth import Sealed
from benchctl_instruments.errors import InstrumentError, UsageError

SETTINGS, TRIALS = "proof.json", "trials"

_LONGEST_S = 900.0

_Trial = TypeVar("_Trial")

OnStatus = Callable[[int, str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofSettings:
    """The settings of a proof.

    `only` names the classes, the usual ones if it is empty; `generic`: also run the sparse regression; `keep`: keep the
    recordings; `jobs`: number of trials that run at once.
    """

    seed: int
    trials: int
    only: tuple[ClassName, ...] = ()
    generic: bool = True
    keep: bool = False
    jobs: int = 2


def run_proof(settings: ProofSettings, folder: Path, *, on_status: OnStatus, stop: StopRequest) -> Iterator[Trial]:
    """Yield the trials as they finish, beginning with those that the folder already holds.

    Parameters
    ----------
    settings
        The settings of the proof.
    folder
        Where the trials are kept: new, empty, or that of the same proof.
    on_status
        Called from any thread with the number of a trial and its status.
    stop
        A stop request ends the running processes and raises `StoppedError`.

    Raises
    ------
    UsageError
        If the folder holds another proof or cannot be written.
    InstrumentError
        If the simulated bench failed.
    """
    claim(folder, {"seed": settings.seed, "only": list(settings.only), "generic": settings.generic})
    run = _Run(settings, folder, on_status, stop)
    kinds = allotted(settings.trials, settings.only)
    yield from as_finished(folder, len(kinds), read_trial, lambda index: run(index, kinds[index]), settings.jobs)


def as_finished(
    folder: Path, trials: int, kept: Callable[[Path], _Trial], run: Callable[[int], _Trial], jobs: int
) -> Iterator[_Trial]:
    """Yield the trials of a folder: first those `kept` there, then those `run`, `jobs` at once, as they finish."""
    missing = []
    for index in range(trials):
        path = path_of(folder, index)
        if path.exists():
            yield kept(path)
        else:
            missing.append(index)
    with ThreadPoolExecutor(jobs) as pool:
        runs = [pool.submit(run, index) for index in missing]
        try:
            for one in as_completed(runs):
                yield one.result()
        finally:
            for one in runs:
                one.cancel()


@dataclass(frozen=True, slots=True)
class _Run:
    """Runs one trial."""

    settings: ProofSettings
    folder: Path
    on_status: OnStatus
    stop: StopRequest

    def __call__(self, index: int, kind: ClassName) -> Trial:
        self.stop.heed()
        if self.settings.keep:
            work = self.folder / f"recording-{index:04d}"
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
        else:
            work = Path(tempfile.mkdtemp(prefix=f".{index:04d}-", dir=self.folder))
        try:
            trial = self._trial(index, kind, work)
        finally:
            if not self.settings.keep:
                shutil.rmtree(work, ignore_errors=True)
        write_trial(path_of(self.folder, index), trial)
        self.on_status(index, "right" if trial.physics.right else "wrong")
        return trial

    def _trial(self, index: int, kind: ClassName, work: Path) -> Trial:
        sealed = self._sealed(index, kind, work)
        part = CLASSES[kind].part
        physics = self._asked("physics", sealed["recording"], work, sealed["without"], part)
        with_generic = self.settings.generic and part == "gyro"
        generic = self._asked("generic", sealed["recording"], work, ()) if with_generic else None
        truth = drawn(self.settings.seed, index, kind)
        if truth.digest() != sealed["digest"]:
            raise UsageError(
                f"trial {index}: what was sealed as {sealed['digest']} is not what is unsealed; "
                "begin anew with another --out"
            )
        return Trial(
            index=index,
            kind=kind,
            digest=sealed["digest"],
            truth=truth.as_json(),
            rows=sealed["rows"],
            recorded_s=sealed["wall_s"],
            physics=_scored(truth, physics, score_diagnosis),
            generic=None if generic is None else _scored(truth, generic, score_regression),
        )

    def _sealed(self, index: int, kind: ClassName, work: Path) -> dict[str, Any]:
        """Draw, seal and record in a separate process; return what it reported."""
        options = {"--seed": self.settings.seed, "--index": index, "--class": kind, "--out": work / "campaign"}
        arguments = [str(word) for pair in options.items() for word in pair]
        try:
            text = run_module("benchctl.proof.seal", *arguments, stop=self.stop, longest_s=_LONGEST_S)
        except ProcessFailedError as err:
            self.stop.ask(f"trial {index}")
            raise InstrumentError(f"trial {index}: the simulated bench could not be recorded: {err}") from err
        report: dict[str, Any] = {}
        for line in text.splitlines():
            report |= json.loads(line)
        self.on_status(index, f"sealed, sha256 {report['digest']}")
        return report

    def _asked(
        self, arm: str, recording: str, work: Path, without: Sequence[str], part: Part = "gyro"
    ) -> dict[str, Any]:
        """Return the answer of an arm from a separate process, which knows only the recording's path."""
        out = work / f"{arm}.json"
        arguments = [recording, "--arm", arm, "--out", str(out), "--without", ",".join(without), "--part", part]
        try:
            run_module("benchctl.proof.blind", *arguments, stop=self.stop, longest_s=_LONGEST_S)
        except ProcessFailedError as err:
            return {"error": str(err)}
        found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
        return found


def _scored(truth: Sealed, found: Mapping[str, Any], score: Callable[[Sealed, Mapping[str, Any]], Score]) -> Answer:
    if "error" in found:
        return Answer(score=None, error=found["error"])
    answer = found["said"]
    findings = answer.get("findings", [])
    return Answer(
        score=score(truth, answer),
        stated=tuple(answer["effects"] if "effects" in answer else [one["effect"] for one in findings]),
        verdict=answer.get("verdict", ""),
        coordinates=tuple(answer.get("unexplained", {}).get("coordinates", ())),
        models=tuple(one["name"] for one in models_in(answer.get("unexplained", {}))),
        unexplained=bool(answer.get("unexplained", {}).get("significant", False)),
        alternatives={one["effect"]: [other["effect"] for other in one["alternatives"]] for one in findings},
        seconds=found["seconds"],
        peak_bytes=found["peak_bytes"],
    )


def claim(folder: Path, identity: Mapping[str, Any]) -> None:
    """Claim the folder for this proof; trials may be added later, the other settings must not change."""
    path = folder / SETTINGS
    with disk_errors(folder):
        (folder / TRIALS).mkdir(parents=True, exist_ok=True)
        before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    if before is not None and before != identity:
        raise UsageError(f"{folder}: holds another proof, {before}; this one is {identity}; name another --out")
    if before is None:
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(identity) + "\n", encoding="utf-8")


def path_of(folder: Path, index: int) -> Path:
    """Return the path of a finished trial."""
    return folder / TRIALS / f"{index:04d}.json"
