"""Fit, diagnosis and acceptance of recordings: frozen results, and their reports where a folder is named."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from benchctl.api.reading import Source, paths_of, unchanged_paths_of
from benchctl.diagnosis.result import Diagnosis, Finding, Part
from benchctl.diagnosis.result import Verdict as DiagnosisVerdict
from benchctl.metrology.limit_file import read_limits
from benchctl.metrology.result import Acceptance, Judged, Verdict
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.reports.accepting import accept_recording
from benchctl.reports.diagnosing import diagnose_recordings, write_diagnosed
from benchctl.reports.fitting import calibrated
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A calibration; `print` shows it as `benchctl fit` does.

    Attributes
    ----------
    coefficients
        The content of `coefficients.json`: stages, joint fit, covariances, valid ranges,
        expanded uncertainties (95.45 %).
    error_percent
        The largest residual rate over the largest rate, in percent, on runs that no fit has seen; by level: `raw`,
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


def fit(recordings: Source | Iterable[Source], *, out: str | PathLike[str] | None = None) -> Fitted:
    """Fit the two-stage calibration and the joint one to a recording, or to several of one unit.

    With `out`, `coefficients.json` and `report.html` are written there; without, nothing is.

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
    found = calibrated(paths_of(recordings, "fitted"))
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
    """A diagnosis; `print` shows what it says.

    `verdict` is `consistent`, `recalibrate`, `missing-physics` or `unknown-structure`; each finding names an effect,
    its parameters with 95 % intervals in their units, where it is seen, and what else it could be. `diagnosis` has all
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
    told = read_limits(Path(limits))
    paths = paths_of(recording, "accepted")
    if language not in ("en", "ru"):
        raise UsageError(f"language {language!r}: expected en or ru")
    found = accept_recording(paths[0], told)
    written = {} if out is None else found.write(Path(out), language)
    return Accepted(
        verdict=found.acceptance.verdict,
        tests=found.acceptance.judged,
        acceptance=found.acceptance,
        says=found.lines(language),
        files=written,
    )
