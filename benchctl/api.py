"""The Python interface: plan, run, resume, simulate, open, fit, apply, diagnose, accept and allan.

Each is a function that returns a frozen result.

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
from contextlib import nullcontext
from functools import partial
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from benchctl.app import accept as accepting
from benchctl.app import allan as analysing
from benchctl.app import diagnose as diagnosing
from benchctl.app import fit as fitting
from benchctl.app import run as running
from benchctl.app.accept import Accepted
from benchctl.app.allan import AllanResult
from benchctl.app.compensate import Compensated, compensate
from benchctl.app.diagnose import Diagnosed
from benchctl.app.fit import FitResult
from benchctl.app.run import Watch
from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.calibration.coefficients import By
from benchctl.campaign.runner import Moment, Outcome, Progress, no_progress
from benchctl.diagnosis.result import Part
from benchctl.plan import Plan, Procedure
from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts
from benchctl.recordings.reader import Recording, open_recording
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, SafetyError, UsageError

__all__ = [
    "Accepted",
    "AllanResult",
    "Bench",
    "BenchError",
    "Compensated",
    "Diagnosed",
    "FitResult",
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
    "allan",
    "apply",
    "diagnose",
    "fit",
    "load_bench",
    "open",
    "plan",
    "resume",
    "run",
    "simulate",
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


def _paths_of(recordings: Source | Iterable[Source], therefore: str) -> list[Path]:
    """Return the paths of one or several recordings; raise `UsageError` if there are none.

    `therefore` is the past participle of the action, such as "fitted", for the message.
    """
    given = [recordings] if isinstance(recordings, Recording | Outcome | str | PathLike) else list(recordings)
    if not given:
        raise UsageError(f"nothing was {therefore}: expected a recording, or several of one unit, got none")
    return [_path_of(one) for one in given]


def _path_or_none(path: str | PathLike[str] | None) -> Path | None:
    return None if path is None else Path(path)


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


def _planned(given: Plan | Procedure | str | PathLike[str]) -> Plan:
    return given if isinstance(given, Plan) else plan(given)


def run(
    plan: Plan | Procedure | str | PathLike[str],
    bench: Bench | str | PathLike[str] = SIMULATED,
    *,
    out: str | PathLike[str] | None = None,
    seed: int | None = None,
    progress: Progress = no_progress,
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
    chosen, planned = running.bench_of(bench, seed), _planned(plan)
    folder = running.new_folder(planned.procedure, chosen.unit.serial) if out is None else Path(out)
    outcome = running.play(planned, chosen, folder, watch=_watch(progress, 3), wires=wires)
    if check:
        outcome.raise_error()
    return outcome


def _watch(progress: Progress, level: int) -> Watch:
    """Warn in the name of the caller of a function here, `level` calls above where the warning is given."""
    return Watch(warn=partial(warnings.warn, stacklevel=level), progress=nullcontext(progress))


def resume(
    campaign: str | PathLike[str],
    plan: Plan | Procedure | str | PathLike[str],
    bench: Bench | str | PathLike[str] = SIMULATED,
    *,
    seed: int | None = None,
    progress: Progress = no_progress,
    wires: bool = True,
    check: bool = True,
) -> Outcome:
    """Resume a campaign that ended early: its folder, with the plan, bench and `wires` that it began with in `api.run`.

    A real bench moves at once. If all steps are complete, the campaign is only closed, and nothing moves.

    Raises
    ------
    UsageError
        Before anything moves: the folder contains no campaign, it was begun with something else, or it is in use.
    BenchError
        As in `api.run`.

    Examples
    --------
    >>> from benchctl import api
    >>> plan = api.plan("static", soak_s=60, duration_s=10)
    >>> api.resume("stopped", plan).status
    'complete'
    """
    chosen, seeded = running.bench_of(bench, seed), seed is not None
    watch = _watch(progress, 4)
    outcome = running.resume(_planned(plan), chosen, Path(campaign), watch=watch, seeded=seeded, wires=wires)
    if check:
        outcome.raise_error()
    return outcome


def simulate(
    plan: Plan | Procedure | str | PathLike[str],
    output: str | PathLike[str],
    bench: Bench | str | PathLike[str] = SIMULATED,
    *,
    model: str | PathLike[str] | None = None,
    seed: int | None = None,
    progress: Progress = no_progress,
) -> Outcome:
    """Record a plan on a simulated bench without the instrument protocols; only the file `output` is written.

    Plan, bench, seed and progress are as in `api.run`. The bench follows a `model` file, for example of a diagnosis.

    Raises
    ------
    UsageError
        If the bench is real, the model cannot be used, or `output` exists or cannot be written.
    BenchError
        The error that ended the run early; nothing is kept then.

    Examples
    --------
    >>> from benchctl import api
    >>> plan = api.plan("static", soak_s=60, duration_s=10)
    >>> api.simulate(plan, "rest.h5", seed=7).samples
    5000
    """
    chosen, watch = running.bench_of(bench, None), _watch(progress, 4)
    followed = _path_or_none(model)
    return running.simulate(_planned(plan), chosen, Path(output), watch=watch, model=followed, seed=seed)


def fit(
    recordings: Source | Iterable[Source],
    *,
    out: str | PathLike[str] | None = None,
    model: str | PathLike[str] | None = None,
) -> FitResult:
    """Fit the two-stage calibration and the joint one to a recording, or to several of one unit.

    `coefficients.json` and `report.html` are written to `out`, if given. The unnamed structures in a diagnosis' `model`
    file are subtracted from the output before the fit, and become part of the coefficients. Of a unit of three axes
    that was turned (procedure three_axes) the coefficients are `matrix` and `bias_dps`.

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
    return fitting.fit(_paths_of(recordings, "fitted"), out=_path_or_none(out), model=_path_or_none(model))


def apply(
    recording: Source, coefficients: str | PathLike[str], output: str | PathLike[str], *, law: By | None = None
) -> Compensated:
    """Compensate a recording: write the copy `output` with the compensated rate, the channel `compensated_dps`.

    Of a unit of three axes, the channels are `frame_compensated_x_dps` and so on.

    `coefficients` is a file that `api.fit` wrote; `law` chooses its joint fit, the default if there is one, or its
    stages. The channel `compensated_valid` is 1 where rate and temperature are in the measured range.

    Raises
    ------
    UsageError
        If `output` exists or cannot be written, the coefficients are unusable or of another unit, or the recording
        cannot be read or compensated or was changed.

    Examples
    --------
    >>> from benchctl import api
    >>> fitted = api.fit("sweep", out="sweep")
    >>> compensated = api.apply("sweep", fitted.files["coefficients"], "compensated.h5")
    >>> compensated.compensation.by, compensated.applied.samples > 10_000
    ('joint', True)
    """
    return compensate(_path_of(recording), Path(coefficients), Path(output), law=law)


def diagnose(
    recordings: Source | Iterable[Source],
    *,
    model: str | PathLike[str] | None = None,
    part: Part | None = None,
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
        `gyro`; `drive`, with angle and torque or current; `chamber`, with heat and air. By default the gyro, or what
        the recordings are of if they have none.
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
    paths = _paths_of(recordings, "diagnosed")
    found = diagnosing.diagnose(paths, model=_path_or_none(model), part=part, seed=seed, progress=progress)
    return found if out is None else found.write(Path(out))


def accept(
    recording: Source,
    limits: str | PathLike[str],
    *,
    out: str | PathLike[str] | None = None,
    language: str = "en",
    sign: str | PathLike[str] | None = None,
) -> Accepted:
    """Measure the gyro's characteristics from a recording and judge them by a file of limits.

    `acceptance.html`, `.pdf`, `.xml` (JUnit) and `.json` are written to `out`, if given; `language` is that of the
    report, `en` or `ru`. With `sign`, the path of an OpenSSH Ed25519 key, the report is signed, as by
    `benchctl accept --sign`; a passphrase comes from `$BENCHCTL_PASSPHRASE`.

    Raises
    ------
    UsageError
        If the recording cannot be read or was changed, the limits or the key cannot be used, or nothing can be written.

    Examples
    --------
    >>> from benchctl import api
    >>> accepted = api.accept("sweep", "lab/limits.toml")
    >>> [test.verdict for test in accepted.tests if test.measured.name == "scale_factor"]
    ['PASS']
    """
    if language not in ("en", "ru"):
        raise UsageError(f"language {language!r}: expected en or ru")
    if sign is not None and out is None:
        raise UsageError("sign: there is no report to sign; name a folder for it with out")
    key = None if sign is None else accepting.signing_key(Path(sign))
    found = accepting.accept(_path_of(recording), Path(limits), language=language)
    return found if out is None else found.write(Path(out), key)


def allan(
    source: Source,
    *,
    channel: str | None = None,
    rate_hz: float | None = None,
    step: str | None = None,
    scale_v_per_dps: float | None = None,
    out: str | PathLike[str] | None = None,
) -> AllanResult:
    """Compute the Allan deviation and the noise terms of a channel of a recording, or of a column of a text file.

    Parameters
    ----------
    source
        A recording, or the path of a text file with commas.
    channel
        The channel or column; of a recording by default the gyro's.
    rate_hz
        The sample rate of a text file without a time column.
    step
        The step, by name or number; by default the longest static one.
    scale_v_per_dps
        The scale factor by which the output of the gyro, in V, is a rate.
    out
        A folder for `allan.html` and `allan.csv`; without it, nothing is written.

    Raises
    ------
    UsageError
        If the source cannot be read or has no such channel or step, a number cannot be, or nothing can be written.

    Examples
    --------
    >>> from benchctl import api
    >>> found = api.allan("sweep", step="2", scale_v_per_dps=0.05, out="noise")
    >>> found.analysis.series.unit, sorted(found.files)
    ('deg/s', ['report', 'table'])
    """
    found = analysing.allan(
        _path_of(source), channel=channel, rate_hz=rate_hz, step=step, scale_v_per_dps=scale_v_per_dps
    )
    return found if out is None else found.write(Path(out))
