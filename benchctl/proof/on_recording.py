"""Sealed trials on a real recording: effects are added to it and must be distinguished from its own findings.

The reference is the blind diagnosis of the untouched recording: the added effect must be named in addition, none of the
recording's own findings may be lost, and nothing else may be named. Finished trials are kept as files; an interrupted
proof resumes where it stopped.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.campaign.stop import StopRequest
from benchctl.diagnosis.result import Part
from benchctl.documents import read_json
from benchctl.proof.injection import Injection, Untouched, stated_of
from benchctl.proof.processes import ProcessFailedError, run_module
from benchctl.proof.running import OnStatus, as_finished, claim, path_of
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError

UNTOUCHED = "untouched.json"

_LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingProof:
    """What to prove: so many trials on a part of a recording, `jobs` of them at once."""

    recording: Path
    part: Part = "gyro"
    seed: int = 1
    trials: int = 20
    jobs: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectedTrial:
    """A trial after the unsealing.

    `share` is the rms that was added relative to the residual of the untouched recording. `lost` are the recording's
    own findings that were not named again; `made_up` are effects that are neither its own nor the drawn one; `instead`
    is the finding of which the drawn effect was stated as an alternative; `error` is the reason for a missing answer.
    """

    index: int
    digest: str
    effect: str
    parameters: Mapping[str, float]
    share: float
    named: bool = False
    lost: Sequence[str] = ()
    made_up: Sequence[str] = ()
    instead: str = ""
    stated: Mapping[str, float] | None = None
    seconds: float | None = None
    error: str = ""

    @property
    def right(self) -> bool:
        """Whether the answer names the drawn effect and the recording's own, and nothing else."""
        return self.named and not self.lost and not self.made_up


def prove_on(proof: RecordingProof, folder: Path, *, on_status: OnStatus, stop: StopRequest) -> Iterator[InjectedTrial]:
    """Yield the trials as they finish, beginning with those that the folder already holds.

    `on_status` is called from any thread with the number of a trial and its status. A `stop` ends the processes and
    raises `StoppedError`. Raises `UsageError` if the folder holds another proof, or the recording cannot be diagnosed
    or reveals no effect.
    """
    with open_recording(proof.recording) as recording:
        claim(folder, {"recording": recording.digest or str(recording.path), "part": proof.part, "seed": proof.seed})
        run = _Run(proof, folder, on_status, stop, Untouched(recording, _untouched(proof, folder, stop)))
        yield from as_finished(
            folder, proof.trials, lambda path: InjectedTrial(**read_json(path, "trial")), run, proof.jobs
        )


@dataclass(frozen=True, slots=True)
class _Run:
    """Runs one trial."""

    proof: RecordingProof
    folder: Path
    on_status: OnStatus
    stop: StopRequest
    untouched: Untouched

    def __call__(self, index: int) -> InjectedTrial:
        self.stop.heed()
        with tempfile.TemporaryDirectory(prefix=f".{index:04d}-", dir=self.folder) as work:
            trial = self._trial(index, Path(work))
        with whole_file(path_of(self.folder, index)) as temporary:
            temporary.write_text(json.dumps(asdict(trial), indent=1) + "\n", encoding="utf-8")
        self.on_status(index, "right" if trial.right else "wrong")
        return trial

    def _trial(self, index: int, work: Path) -> InjectedTrial:
        injected, answer = work / "recording.h5", work / "said.json"
        given = {"--said": self.folder / UNTOUCHED, "--seed": self.proof.seed, "--index": index, "--out": injected}
        try:
            sealed = self._run("inject", self.proof.recording, *(word for pair in given.items() for word in pair))
        except ProcessFailedError as err:
            raise UsageError(f"trial {index}: {err}") from err
        digest = json.loads(sealed)["digest"]
        self.on_status(index, f"sealed, sha256 {digest}")
        try:
            self._run("blind", injected, "--part", self.proof.part, "--out", answer)
        except ProcessFailedError as err:
            return _unsealed(self._drawn(index, digest), digest, error=str(err))
        found = read_json(answer, "diagnosis")
        return _scored(self._drawn(index, digest), digest, self.untouched.found, found)

    def _drawn(self, index: int, digest: str) -> Injection:
        injection = self.untouched.drawn(self.proof.seed, index)
        if injection.digest() != digest:
            raise UsageError(
                f"trial {index}: the unsealed truth differs from the one sealed as {digest}; use another --out"
            )
        return injection

    def _run(self, module: str, *arguments: object) -> str:
        words = [str(word) for word in arguments]
        return run_module(f"benchctl.proof.{module}", *words, stop=self.stop, longest_s=_LONGEST_S)


def _scored(
    injection: Injection, digest: str, own: Sequence[frozenset[str]], found: Mapping[str, Any]
) -> InjectedTrial:
    """Compare an answer with the truth; for two effects that a recording does not separate a diagnosis states both.

    An effect that is an alternative of another one's finding counts as named, and that finding is then not made up. An
    own finding of the untouched recording is not lost as long as one of the effects stated for it is stated.
    """
    named = {one["effect"]: one for one in found["said"]["findings"]}
    either = {name: stated_of(one) for name, one in named.items()}
    stated = frozenset[str]().union(*either.values())
    there = {injection.effect}.union(*own)
    mine = named.get(injection.effect)
    instead = next((name for name, names in either.items() if injection.effect in names), "")
    return _unsealed(
        injection,
        digest,
        named=injection.effect in stated,
        lost=sorted(" or ".join(sorted(names)) for names in own if names.isdisjoint(stated)),
        made_up=sorted(name for name, names in either.items() if there.isdisjoint(names)),
        instead="" if mine else instead,
        stated=None if mine is None else {name: value["value"] for name, value in mine["parameters"].items()},
        seconds=found["seconds"],
    )


def _unsealed(injection: Injection, digest: str, **found: Any) -> InjectedTrial:
    return InjectedTrial(
        index=injection.index,
        digest=digest,
        effect=injection.effect,
        parameters=injection.parameters,
        share=injection.share,
        **found,
    )


def _untouched(proof: RecordingProof, folder: Path, stop: StopRequest) -> dict[str, Any]:
    """Return the blind diagnosis of the untouched recording, which is made once."""
    path = folder / UNTOUCHED
    if not path.exists():
        with whole_file(path) as temporary:
            arguments = (str(proof.recording), "--part", proof.part, "--out", str(temporary))
            try:
                run_module("benchctl.proof.blind", *arguments, stop=stop, longest_s=_LONGEST_S)
            except ProcessFailedError as err:
                raise UsageError(str(err)) from err
    answer: dict[str, Any] = read_json(path, "diagnosis")["said"]
    return answer


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRow:
    """The trials with one effect: how many named it, the smallest named share and the largest missed one."""

    effect: str
    trials: int
    named: int
    smallest_named: float | None
    largest_missed: float | None


def by_effect(trials: Sequence[InjectedTrial]) -> list[EffectRow]:
    """Return a row per effect, in alphabetical order."""
    rows = []
    for effect in sorted({one.effect for one in trials}):
        own = [one for one in trials if one.effect == effect]
        rows.append(
            EffectRow(
                effect=effect,
                trials=len(own),
                named=sum(one.named for one in own),
                smallest_named=min((one.share for one in own if one.named), default=None),
                largest_missed=max((one.share for one in own if not one.named), default=None),
            )
        )
    return rows


def as_json(proof: RecordingProof, own: Sequence[str], trials: Sequence[InjectedTrial]) -> dict[str, Any]:
    """Return the data of `--json`; `own` are the untouched recording's findings."""
    return {
        "recording": str(proof.recording),
        "part": proof.part,
        "seed": proof.seed,
        "trials": len(trials),
        "untouched": list(own),
        "named": sum(one.named for one in trials),
        "as_alternative": sum(bool(one.instead) for one in trials),
        "lost": sum(bool(one.lost) for one in trials),
        "made_up": sum(bool(one.made_up) for one in trials),
        "right": sum(one.right for one in trials),
        "effects": [asdict(row) for row in by_effect(trials)],
        "digests": [one.digest for one in sorted(trials, key=lambda one: one.index)],
    }


def untouched_findings(folder: Path) -> list[str]:
    """Return the findings of the untouched recording, the reference of the folder's trials."""
    return sorted(one["effect"] for one in read_json(folder / UNTOUCHED, "diagnosis")["said"]["findings"])
