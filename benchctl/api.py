"""benchctl from Python: plan, run, open, fit, diagnose and accept, each a function that gives a frozen result.

>>> from benchctl import api
>>> plan = api.plan("rate_sweep", soak_s=600, rates=3, run_s=10, zero_s=10)
>>> outcome = api.run(plan, out="sweep", seed=7)
>>> fitted = api.fit(outcome)
>>> fitted.error_percent["joint"] < 0.1 < fitted.error_percent["raw"]
True

What cannot be used, and what a bench refuses, is an error of `benchctl_instruments.errors`, all of them `BenchError`,
in one line. Nothing here prints, asks or needs a terminal, but for the steps that a person does on a real bench. It
works in a notebook and outside the main thread, where only signals cannot stop a run.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from benchctl.app.accept import accept_recording
from benchctl.app.diagnose import diagnose_recordings, write_diagnosed
from benchctl.app.fit import calibrated
from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.campaign.playing import new_folder, play
from benchctl.campaign.runner import Moment, Outcome, Progress, nobody
from benchctl.diagnosis.result import Diagnosis, Finding, Part
from benchctl.diagnosis.result import Verdict as DiagnosisVerdict
from benchctl.metrology.limit_file import read_limits
from benchctl.metrology.result import Acceptance, Judged, Verdict
from benchctl.plan import Plan, Procedure
from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.reader import Recording, open_recording
from benchctl.recordings.verify import refuse_changed
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, SafetyError, UsageError

__all__ = [
    "Accepted",
    "Bench",
    "BenchError",
    "Diagnosed",
    "Fitted",
    "InstrumentError",
    "LinkError",
    "Moment",
    "Outcome",
    "Plan",
    "Procedure",
    "Recording",
    "SafetyError",
    "Source",
    "UsageError",
    "accept",
    "diagnose",
    "fit",
    "load_bench",
    "open",
    "plan",
    "run",
]

Source = Recording | Outcome | str | PathLike[str]
"""A recording: what `api.open` or `api.run` gave, or a path: a file, a campaign's folder or an open recording's."""


def open(path: str | PathLike[str]) -> Recording:
    """Open a recording for reading: a file, a campaign's folder (running, dead or finished) or an open recording's.

    Its `infos` are the steps; `step(index)` loads one, and `[name]` of that is a channel: `time_s` in s, `encoder_deg`,
    `gyro_v`, `gyro_temp_c`. `with` closes it.

    Raises
    ------
    UsageError
        Where there is none, or it cannot be read.

    Examples
    --------
    >>> from benchctl import api
    >>> with api.open("sweep") as recording:
    ...     turning = recording.step(3)
    >>> turning.info.kind, turning["gyro_v"].shape == turning["time_s"].shape
    ('constant_rate', True)
    """
    return open_recording(Path(path))


def paths_of(recordings: Source | Iterable[Source], therefore: str) -> list[Path]:
    """The paths of one recording or of several; raises `UsageError` where there is none, and so nothing `therefore`."""
    given = [recordings] if isinstance(recordings, Recording | Outcome | str | PathLike) else list(recordings)
    if not given:
        raise UsageError(f"nothing was {therefore}: expected a recording, or several of one unit, got none")
    return [_path_of(one) for one in given]


def unchanged_paths_of(recordings: Source | Iterable[Source], therefore: str) -> list[Path]:
    """As `paths_of`, none of them changed since it was written: `UsageError` names the one that is not `therefore`."""
    paths = paths_of(recordings, therefore)
    for path in paths:
        refuse_changed(path, therefore)
    return paths


def _path_of(recording: Source) -> Path:
    if isinstance(recording, Recording):
        return recording.path
    return recording.recording if isinstance(recording, Outcome) else Path(recording)


def plan(procedure: str | PathLike[str] | Procedure, **parameters: Any) -> Plan:
    """The steps of a procedure with these parameters; the others keep their defaults.

    Parameters
    ----------
    procedure
        Its name (`benchctl procedures` lists them), the path of a .py file, or a function with `@procedure`.
    parameters
        Numbers, texts and sequences of numbers, in the units that the procedure's parameters name.

    Raises
    ------
    UsageError
        Where there is no such procedure or parameter, a value is of the wrong type, or they give no plan.

    Examples
    --------
    >>> from benchctl import api
    >>> plan = api.plan("static", at_c=25, duration_s=60)
    >>> [step.kind for step in plan.steps]
    ['soak', 'static']
    """
    found = procedure if isinstance(procedure, Procedure) else find_procedure(fspath(procedure))
    return found.expand(as_texts(_plain(parameters)))


def _plain(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Numpy's arrays and numbers as Python's own."""
    return {name: value.tolist() if hasattr(value, "tolist") else value for name, value in parameters.items()}


_plan_of = plan


def run(
    plan: Plan | Procedure | str | PathLike[str],
    bench: Bench | str | PathLike[str] = SIMULATED,
    *,
    out: str | PathLike[str] | None = None,
    seed: int | None = None,
    progress: Progress = nobody,
    wires: bool = True,
    check: bool = True,
) -> Outcome:
    """Run a plan on a bench and record it. Whatever ends it, the bench is brought to rest and the recording closed.

    Parameters
    ----------
    plan
        What `api.plan` gave; or what it takes, with the parameters' defaults.
    bench
        A bench.toml, a `Bench`, or "simulated", which needs neither file nor hardware.
    out
        The campaign's folder; by default a new one in results/.
    seed
        Draws the noise and the errors of a simulated bench, 0 or more; by default those that its file states.
    progress
        Called with a `Moment`, several times a second of wall time: step, temperatures in °C, rate in deg/s, time left
        in s of bench time.
    wires
        False takes simulated instruments without their protocols: the same physics, faster.
    check
        Raise the error that ended the campaign early. Without it the outcome has it: `status`, `error`.

    Raises
    ------
    UsageError
        Before anything moves: the plan goes beyond the bench's limits, the disk has no room, the folder is in use.
    BenchNotReadyError
        Names every instrument that did not answer, and why.
    BenchError
        What ended the campaign early, Ctrl-C included; a note names its recording.

    Examples
    --------
    >>> from benchctl import api
    >>> outcome = api.run(api.plan("static", soak_s=60, duration_s=10), out="rest", seed=7)
    >>> outcome.status, outcome.whole, outcome.samples
    ('complete', 2, 5000)
    """
    chosen = bench if isinstance(bench, Bench) else load_bench(fspath(bench))
    if seed is not None and (seed < 0 or not chosen.simulated):
        raise UsageError(f"seed = {seed}: expected 0 or more, and a bench with simulated = true; this is {chosen.name}")
    planned = plan if isinstance(plan, Plan) else _plan_of(plan)
    folder = new_folder(planned.procedure, chosen.unit.serial) if out is None else Path(out)
    shown: AbstractContextManager[Progress] = nullcontext(progress)
    outcome = play(planned, chosen.with_seed(seed), folder, warn=_warn, progress=shown, wires=wires)
    if check and outcome.error is not None:
        outcome.error.add_note(f"the recording of what was done: {outcome.recording}")
        raise outcome.error
    return outcome


def _warn(message: str) -> None:
    warnings.warn(message, stacklevel=4)  # the caller of `run`


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A calibration; `print` shows it as `benchctl fit` does.

    Attributes
    ----------
    coefficients
        The content of `coefficients.json`: stages, joint fit, covariances, valid ranges,
        expanded uncertainties (95.45 %).
    error_percent
        The largest residual rate over the largest rate, in percent, on held-out runs; by level: `raw`,
        `stage_1`, `stage_2`, `joint`, as far as the recording allows.
    rms_percent
        The same of the rms.
    K0_v_per_dps, U0_v
        Of the last stage.
    warnings
        What the recording could not show, in words.
    files
        `coefficients` and `report`, where they were written.
    """

    coefficients: Mapping[str, Any]
    error_percent: Mapping[str, float]
    rms_percent: Mapping[str, float]
    K0_v_per_dps: float
    U0_v: float
    warnings: tuple[str, ...]
    says: str = field(repr=False)
    files: Mapping[str, Path] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.says


def fit(
    recordings: Source | Iterable[Source],
    *,
    out: str | PathLike[str] | None = None,
    model: str | PathLike[str] | None = None,
) -> Fitted:
    """Fit the two-stage calibration and the joint one to a recording, or to several of one unit.

    With `out`, `coefficients.json` and `report.html` are written there; without, nothing is. The structures without a
    name in a diagnosis' `model` file are taken off the output first, and become part of the coefficients.

    Raises
    ------
    UsageError
        Where a recording cannot be read or fitted, was changed, is of another unit, or nothing can be written.

    Examples
    --------
    >>> from benchctl import api
    >>> fitted = api.fit("sweep", out="sweep")
    >>> f"{fitted.K0_v_per_dps:.3f} V/(deg/s)", sorted(fitted.files)
    ('0.050 V/(deg/s)', ['coefficients', 'report'])
    """
    found = calibrated(paths_of(recordings, "fitted"), None if model is None else Path(model))
    written: dict[str, Path] = {}
    if out is not None:
        folder = Path(out)
        values = found.write(folder).values
        written = {name: values[name] for name in ("coefficients", "report")}
        add_to_manifest(folder, written.values())
    return Fitted(
        coefficients=found.content,
        error_percent=found.values["error_percent"],
        rms_percent=found.values.get("rms_percent", {}),
        K0_v_per_dps=found.values["K0_v_per_dps"],
        U0_v=found.values["U0_v"],
        warnings=tuple(found.values.get("warnings", ())),
        says=found.says,
        files=written,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosed:
    """A diagnosis; `print` shows its text.

    `verdict` is `consistent`, `recalibrate`, `missing-physics` or `unknown-structure`; each finding names an effect,
    its parameters with 95 % intervals in their units, its coordinate, and what else it could be. `diagnosis` has all
    of it; its `as_json()` is what `benchctl diagnose --json` writes. `files` are `report`, `summary` and `model`, where
    they were written.
    """

    verdict: DiagnosisVerdict
    findings: tuple[Finding, ...]
    diagnosis: Diagnosis = field(repr=False)
    files: Mapping[str, Path] = field(default_factory=dict)

    def __str__(self) -> str:
        return "\n".join([self.diagnosis.says, *(finding.says for finding in self.findings)])


def diagnose(
    recordings: Source | Iterable[Source],
    *,
    model: str | PathLike[str] | None = None,
    part: Part = "gyro",
    seed: int = 0,
    out: str | PathLike[str] | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosed:
    """Say where a recording, or several of one unit jointly, part from the lab's model, and what physics is missing.

    Parameters
    ----------
    recordings
        One, or several; what `api.run` or `api.open` gave, or paths.
    model
        A file with the lab's model of the part; by default the one that the first recording names.
    part
        `gyro`; `drive`, of angle and torque or current; `chamber`, of heat and air.
    seed
        Draws the recordings with nothing missing, for comparison; the same seed gives the same result.
    out
        A folder for `diagnosis.html`, and `model.toml` with what was found; without it nothing is written.
    progress
        Called with what is tried and which share of the work, 0 to 1, is done.

    Raises
    ------
    UsageError
        Where a recording cannot be read or diagnosed, was changed, is of another unit, or nothing can be written.

    Examples
    --------
    >>> from benchctl import api
    >>> found = api.diagnose("points.h5")
    >>> found.verdict, [finding.effect for finding in found.findings]
    ('missing-physics', ['rate_nonlinearity'])
    """
    paths = unchanged_paths_of(recordings, "diagnosed")
    named = None if model is None else Path(model)
    found = diagnose_recordings(paths, model=named, part=part, seed=seed, progress=progress)
    written: dict[str, Path] = {}
    if out is not None:
        written = write_diagnosed(found, Path(out))
        add_to_manifest(Path(out), written.values())
    diagnosis = found.diagnosis
    return Diagnosed(verdict=diagnosis.verdict, findings=diagnosis.findings, diagnosis=diagnosis, files=written)


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """An acceptance; `print` shows it as `benchctl accept` does.

    `verdict` is that of all tests together, PASS only where everything with a limit passes. A test has `measured`
    (value, expanded uncertainty at 95.45 %, unit), `limit` and its own `verdict`: PASS, FAIL, INCONCLUSIVE, or None
    where it has no limit. `files` are `report`, `pdf`, `junit` and `json`, where they were written.
    """

    verdict: Verdict
    tests: tuple[Judged, ...] = field(repr=False)
    acceptance: Acceptance = field(repr=False)
    says: str = field(repr=False)
    files: Mapping[str, Path] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.says


def accept(
    recording: Source,
    limits: str | PathLike[str],
    *,
    out: str | PathLike[str] | None = None,
    language: str = "en",
) -> Accepted:
    """Measure what a recording shows of its gyro and judge it by a file of limits.

    With `out`, `acceptance.html`, `.pdf`, `.xml` (JUnit) and `.json` are written there; `language` is that of the
    report, `en` or `ru`.

    Raises
    ------
    UsageError
        Where the recording cannot be read or was changed, the limits cannot be used, or nothing can be written.

    Examples
    --------
    >>> from benchctl import api
    >>> accepted = api.accept("sweep", "lab/limits.toml")
    >>> [test.verdict for test in accepted.tests if test.measured.name == "scale_factor"]
    ['PASS']
    """
    limits_read = read_limits(Path(limits))
    paths = paths_of(recording, "accepted")
    if language not in ("en", "ru"):
        raise UsageError(f"language {language!r}: expected en or ru")
    found = accept_recording(paths[0], limits_read)
    written = {} if out is None else found.write(Path(out), language)
    return Accepted(
        verdict=found.acceptance.verdict,
        tests=found.acceptance.judged,
        acceptance=found.acceptance,
        says=found.lines(language),
        files=written,
    )
