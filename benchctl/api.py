"""The Python interface: plan, run, open, fit, diagnose and accept, each a function that returns a frozen result.

>>> from benchctl import api
>>> plan = api.plan("rate_sweep", soak_s=600, rates=3, run_s=10, zero_s=10)
>>> outcome = api.run(plan, out="sweep", seed=7)
>>> fitted = api.fit(outcome)
>>> fitted.error_percent["joint"] < 0.1 < fitted.error_percent["raw"]
True

Unusable input and refusals of a bench raise an exception of `benchctl_instruments.errors`, a `BenchError` with a
one-line message. No function prints, asks for input or needs a terminal, except for steps that an operator performs on
a real bench. The functions work in a notebook and outside the main thread, where signals cannot stop a run.
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
"""A recording: a result of `api.open` or `api.run`, or a path of a file, a campaign's folder or an open recording."""


def open(path: str | PathLike[str]) -> Recording:
    """Open a recording for reading: a file, a campaign's folder (running, crashed or finished) or an open recording.

    `infos` describes its steps; `step(index)` loads one step, and `[name]` of a step is a channel: `time_s` in s,
    `encoder_deg`, `gyro_v`, `gyro_temp_c`. Use `with` to close the recording.

    Raises
    ------
    UsageError
        If there is no recording, or it cannot be read.

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
    """Return the paths of one or several recordings; raise `UsageError` if there are none.

    `therefore` is the past participle of the action, such as "fitted", for the message.
    """
    given = [recordings] if isinstance(recordings, Recording | Outcome | str | PathLike) else list(recordings)
    if not given:
        raise UsageError(f"nothing was {therefore}: expected a recording, or several of one unit, got none")
    return [_path_of(one) for one in given]


def unchanged_paths_of(recordings: Source | Iterable[Source], therefore: str) -> list[Path]:
    """Return the same as `paths_of`; raise `UsageError` if a recording has changed since it was written."""
    paths = paths_of(recordings, therefore)
    for path in paths:
        refuse_changed(path, therefore)
    return paths


def _path_of(recording: Source) -> Path:
    if isinstance(recording, Recording):
        return recording.path
    return recording.recording if isinstance(recording, Outcome) else Path(recording)


def plan(procedure: str | PathLike[str] | Procedure, **parameters: Any) -> Plan:
    """Return the plan of a procedure with these parameters; the others keep their defaults.

    Parameters
    ----------
    procedure
        Its name (`benchctl procedures` lists them), the path of a .py file, or a function with `@procedure`.
    parameters
        Numbers, texts and sequences of numbers, in the units that the procedure's parameter names state.

    Raises
    ------
    UsageError
        If there is no such procedure or parameter, a value has the wrong type, or the parameters give no plan.

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
    """Convert numpy arrays and numbers to Python lists and numbers."""
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
    """Run a plan on a bench and record it. In every case, the bench is brought to rest and the recording closed.

    Parameters
    ----------
    plan
        A result of `api.plan`; or any procedure that it accepts, run with the parameters' defaults.
    bench
        A bench.toml, a `Bench`, or "simulated", which needs neither file nor hardware.
    out
        The campaign's folder; by default a new one in results/.
    seed
        The seed, 0 or more, of the noise and the errors of a simulated bench; by default that of its file.
    progress
        Called with a `Moment` several times per second of wall time: step, temperatures in °C, rate in deg/s, remaining
        bench time in s.
    wires
        If false, use simulated instruments without their protocols: the same physics, but faster.
    check
        Raise the error that ended the campaign early. If false, the outcome contains it: `status`, `error`.

    Raises
    ------
    UsageError
        Before anything moves: the plan exceeds the bench's limits, the disk has no room, or the folder is in use.
    BenchNotReadyError
        If instruments do not answer; names each of them, with the reason.
    BenchError
        The error that ended the campaign early, Ctrl-C included; a note names the recording.

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
    """A calibration; `print` shows the text of `benchctl fit`.

    Attributes
    ----------
    coefficients
        The content of `coefficients.json`: stages, joint fit, covariances, valid ranges,
        expanded uncertainties (95.45 %).
    error_percent
        The largest residual rate divided by the largest rate, in percent, on held-out runs; by level: `raw`,
        `stage_1`, `stage_2`, `joint`, as far as the recording allows.
    rms_percent
        The same for the rms of the residual rate.
    K0_v_per_dps, U0_v
        Scale factor and offset of the last stage.
    warnings
        Messages on quantities that the recording could not determine.
    files
        The paths of `coefficients` and `report`, if they were written.
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

    `coefficients.json` and `report.html` are written to `out`, if given. The unnamed structures in a diagnosis' `model`
    file are subtracted from the output before the fit, and become part of the coefficients.

    Raises
    ------
    UsageError
        If a recording cannot be read or fitted, was changed, is of another unit, or nothing can be written.

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

    `verdict` is `consistent`, `recalibrate`, `missing-physics` or `unknown-structure`. Each finding names an effect,
    its parameters with 95 % intervals in their units, its coordinate, and the alternatives. `diagnosis` is the complete
    result; its `as_json()` is the output of `benchctl diagnose --json`. `files` are the paths of `report`, `summary`
    and `model`, if they were written.
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
    """Find where one or several recordings of a unit deviate from the lab's model, and which physics is missing.

    Parameters
    ----------
    recordings
        One, or several to be diagnosed jointly: results of `api.run` or `api.open`, or paths.
    model
        A file with the lab's model of the part; by default the one that the first recording names.
    part
        `gyro`; `drive`, with angle and torque or current; `chamber`, with heat and air.
    seed
        The seed of the simulated recordings without missing physics, used for comparison; it makes the result
        reproducible.
    out
        A folder for `diagnosis.html` and for `model.toml` with the findings; without it, nothing is written.
    progress
        Called with the current trial and the completed fraction of the work, 0 to 1.

    Raises
    ------
    UsageError
        If a recording cannot be read or diagnosed, was changed, is of another unit, or nothing can be written.

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
    """An acceptance; `print` shows the text of `benchctl accept`.

    `verdict` is the overall verdict, PASS only if every test with a limit passes. A test has `measured` (value,
    expanded uncertainty at 95.45 %, unit), `limit` and its own `verdict`: PASS, FAIL, INCONCLUSIVE, or None without a
    limit. `files` are the paths of `report`, `pdf`, `junit` and `json`, if they were written.
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
    """Measure the gyro's characteristics from a recording and judge them by a file of limits.

    `acceptance.html`, `.pdf`, `.xml` (JUnit) and `.json` are written to `out`, if given; `language` is that of the
    report, `en` or `ru`.

    Raises
    ------
    UsageError
        If the recording cannot be read or was changed, the limits cannot be used, or nothing can be written.

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
