"""Calibrate on recordings, and write `coefficients.json` and `report.html`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.coefficients import coefficients, points_coefficients, write_coefficients
from benchctl.calibration.discovered import Discovered, discovered_of
from benchctl.calibration.result import CalibrationOptions, CalibrationResult
from benchctl.calibration.static_points_fit import StaticPointsResult, fit_static_points
from benchctl.calibration.three_axes import ThreeAxesResult, fit_three_axes, three_axes_coefficients, turned_steps
from benchctl.model_file import read_model
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.reader import Recording, join
from benchctl.recordings.static_points import KIND, StaticPoints
from benchctl.recordings.verify import opened_unchanged
from benchctl.reports import text
from benchctl.reports.calibration_page import calibration_page
from benchctl.reports.coefficient_tables import joint_coefficients, stage_tables
from benchctl.reports.html import write_page
from benchctl.reports.points_page import coefficients as points_of
from benchctl.reports.points_page import static_points_page
from benchctl.reports.results import make_folder, may_be_made, source_digest
from benchctl.reports.three_axes_page import axes_tables, three_axes_page
from benchctl.signals.under_test import under_test
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class FitResult:
    """A calibration; `print` shows the text of `benchctl fit`.

    Attributes
    ----------
    coefficients
        The content of `coefficients.json`: stages, joint fit, covariances, valid ranges,
        expanded uncertainties (95.45 %); of a unit of three axes `matrix` and `bias_dps`.
    values
        The data of `benchctl fit --json` without the paths.
    files
        The paths of `coefficients` and `report`, if they were written.
    """

    coefficients: Mapping[str, Any]
    values: Mapping[str, Any] = field(repr=False)
    says: str = field(repr=False)
    write_report: Callable[[Path], None] = field(repr=False)
    files: Mapping[str, Path] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.says

    @property
    def error_percent(self) -> Mapping[str, float]:
        """The largest residual rate divided by the largest rate, in percent, on held-out runs, by level.

        The levels are `raw`, `stage_1`, `stage_2` and `joint`, as far as the recording allows.
        """
        return dict(self.values["error_percent"])

    @property
    def rms_percent(self) -> Mapping[str, float]:
        """The same for the rms of the residual rate."""
        return dict(self.values.get("rms_percent", {}))

    @property
    def K0_v_per_dps(self) -> float:  # noqa: N802 - the field's own letters
        """Scale factor of the last stage."""
        return self._of_one_axis("K0_v_per_dps")

    @property
    def U0_v(self) -> float:  # noqa: N802 - as above
        """Offset of the last stage."""
        return self._of_one_axis("U0_v")

    def _of_one_axis(self, name: str) -> float:
        if name not in self.values:
            raise UsageError(f"a fit of three axes has no {name}; read coefficients['matrix'] and ['bias_dps']")
        return float(self.values[name])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Messages on quantities that the recording could not determine."""
        return tuple(self.values.get("warnings", ()))

    def write(self, folder: Path) -> FitResult:
        """Write both files into a folder and its manifest, and return the result with their paths.

        Raises `UsageError` if they cannot be written.
        """
        make_folder(folder)
        files = {"coefficients": folder / "coefficients.json", "report": folder / "report.html"}
        write_coefficients(files["coefficients"], self.coefficients)
        self.write_report(files["report"])
        add_to_manifest(folder, files.values())
        return replace(self, files=files)


def fit(paths: Sequence[Path], *, out: Path | None = None, model: Path | None = None) -> FitResult:
    """Calibrate on one recording, or on several of one unit, and write the files to `out`, if given.

    Steps of a unit of three axes that was turned, as in the procedure three_axes, are fitted as such, and no others.

    Unnamed structures in a `model` file are subtracted from the output first, and become part of the coefficients.

    Raises
    ------
    UsageError
        If a recording cannot be read or fitted or was changed, if the recordings are of different units, if the model
        contains nothing to subtract, or if the results cannot be written.
    """
    discovered = _taken_off(model)
    with opened_unchanged(paths, "fitted") as recordings:
        joined = under_test(join(recordings))
        if out is not None and not may_be_made(out):
            make_folder(out)  # raises the error before any work
        found = _fitted(joined, recordings, discovered)
    return found if out is None else found.write(out)


def _taken_off(model: Path | None) -> Discovered:
    if model is None:
        return Discovered()
    content = read_model(model)
    try:
        return discovered_of(content)
    except UsageError as err:
        raise UsageError(f"model {model}: {err}") from err


def _fitted(joined: Recording, recordings: Sequence[Recording], discovered: Discovered) -> FitResult:
    if any(info.kind == KIND for recording in recordings for info in recording.infos):
        if discovered:
            raise UsageError("--model: from a table of static points nothing is taken off; fit it without")
        return _fit_points(recordings)
    if turned := turned_steps(joined):
        if discovered:
            raise UsageError("--model: from a unit of three axes nothing is taken off; fit it without")
        return _fit_axes(joined, turned, recordings)
    return _fit_runs(joined, recordings, discovered)


def _fit_axes(joined: Recording, turned: Sequence[int], recordings: Sequence[Recording]) -> FitResult:
    meta, infos = joined.meta, joined.infos
    result = fit_three_axes(map(joined.step, turned), meta)
    content = _with_stated(three_axes_coefficients(result, unit=meta.unit.serial, source=_sources(recordings)))
    digest = ", ".join(source_digest(recording) for recording in recordings)
    shown = ("T0_c", "matrix", "bias_dps", "matrix_per_c", "bias_dps_per_c", "uncertainty", "warnings")
    return FitResult(
        coefficients=content,
        values={"error_percent": {}, **{name: content[name] for name in shown if name in content}},
        says=_axes_in_words(result),
        write_report=lambda path: write_page(path, three_axes_page(result, meta, infos, digest=digest)),
    )


def _fit_runs(joined: Recording, recordings: Sequence[Recording], discovered: Discovered) -> FitResult:
    result = calibrate(joined.stored_steps(), joined.meta, CalibrationOptions(discovered=discovered))
    meta, infos = joined.meta, joined.infos
    digest = ", ".join(source_digest(recording) for recording in recordings)
    content = _with_stated(coefficients(result, _sources(recordings)))
    values = {
        "error_percent": dict(result.error_percent),
        "rms_percent": dict(result.rms_percent),
        "free_motion": content["free_motion"],
        "K0_v_per_dps": result.stages[-1].K0_v_per_dps,
        "U0_v": result.stages[-1].U0_v,
        "joint": {
            "law": result.best.law,
            "parameters": {
                name: {key: parameter[key] for key in ("value", "ci95", "expanded", "k", "dof", "unit", "stated")}
                for name, parameter in content["uncertainty"]["parameters"].items()
            },
        },
        "warnings": list(result.warnings),
        **({"discovered": content["discovered"]} if "discovered" in content else {}),
    }
    return FitResult(
        coefficients=content,
        values=values,
        says=_in_words(result),
        write_report=lambda path: write_page(path, calibration_page(result, meta, infos, digest=digest)),
    )


def _fit_points(recordings: Sequence[Recording]) -> FitResult:
    if len(recordings) > 1:
        raise UsageError("a table of static points is fitted by itself; name one recording")
    recording = recordings[0]
    points = StaticPoints.from_step(next(recording.steps(kinds=[KIND])))
    result = fit_static_points(points.rate_dps, points.mean_v, points.std_v)
    meta, digest = recording.meta, source_digest(recording)
    celsius = None if points.temperature_c is None else float(points.temperature_c.mean())
    content = _with_stated(
        points_coefficients(result, unit=recording.meta.unit.serial, temperature_c=celsius, source=_sources(recordings))
    )
    values = {
        "error_percent": {},
        "K0_v_per_dps": result.rotating.K0_v_per_dps,
        "U0_v": result.rotating.U0_v,
        "S_rad_per_dps": {"value": result.rotating.S_rad_per_dps, "ci95": list(result.rotating.S_ci95)},
        "misfit_percent_of_full_scale": content["misfit_percent_of_full_scale"],
        "points_at_rest": {"offset_dps": result.rest_offset_dps, "count": result.rest_points},
    }
    return FitResult(
        coefficients=content,
        values=values,
        says=_points_in_words(result),
        write_report=lambda path: write_page(path, static_points_page(result, points, meta, digest=digest)),
    )


def _sources(recordings: Sequence[Recording]) -> list[tuple[str, str]]:
    return [(str(recording.path), source_digest(recording)) for recording in recordings]


def _with_stated(content: dict[str, Any]) -> dict[str, Any]:
    """Add to each parameter its value as printed in the report."""
    for parameter in content["uncertainty"]["parameters"].values():
        parameter["stated"] = text.with_uncertainty(
            parameter["value"], parameter["expanded"], text.unit_text(parameter.get("unit", ""))
        )
    return content


def _in_words(result: CalibrationResult) -> str:
    levels = [name for name in ("raw", "stage_1", "stage_2", "joint") if name in result.error_percent]
    errors = ", ".join(f"{name.replace('_', ' ')} {result.error_percent[name]:.3g} %" for name in levels)
    lines = [f"error on runs kept aside: {errors}"] if levels else []
    if (free := result.free_motion) is not None:
        lines += [
            f"free motion, in angle: scale factor {free.scale:.5f}, 95 % {free.scale_ci95[0]:.5f} to "
            f"{free.scale_ci95[1]:.5f}; delay {1e3 * free.delay_s:.2f} ms, 95 % {1e3 * free.delay_ci95[0]:.2f} to "
            f"{1e3 * free.delay_ci95[1]:.2f}",
            f"free motion, in angle: residual {free.before_deg:.3f}° before, {free.after_deg:.3f}° after, rms in "
            f"{free.band_hz[0]:g} to {free.band_hz[1]:g} Hz",
        ]
    last = stage_tables(result)[-1]
    stated = ", ".join(f"{row.symbol} = {row.stated}" for row in last.coefficients if row.symbol in ("K0", "U0", "τ"))
    lines.append(f"two stages, after {last.stage.name}: {stated}")
    lines.append(f"joint fit, law {result.best.law}, ± expanded uncertainty, [95 % interval by scatter alone]:")
    lines += [f"  {row.name} = {row.stated}  {row.interval}" for row in joint_coefficients(result.best)]
    lines += [f"taken off the output before the fit: {one.says()}" for one in result.discovered.structures.values()]
    lines += [f"note: {warning}" for warning in result.warnings]
    return "\n".join(lines)


def _axes_in_words(result: ThreeAxesResult) -> str:
    lines = []
    for table in axes_tables(result):
        rows = [("output", *table.columns), *table.rows]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines.append(f"{table.title}, ± expanded uncertainty (95.45 %):")
        lines += ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    lines += [f"note: {warning}" for warning in result.warnings]
    return "\n".join(lines)


def _points_in_words(result: StaticPointsResult) -> str:
    fit = result.rotating
    misfits = (("straight line", fit.line), ("sine law", fit.sine))
    lines = [
        f"{name}: misfit {misfit.rms_dps:.3g} deg/s rms, {misfit.largest_percent_fs:.3g} % of full scale at most"
        for name, misfit in misfits
    ]
    return "\n".join(
        [
            *lines,
            *(f"{row.symbol} = {row.stated}  {row.interval}" for row in points_of(fit, "V")),
            result.says,
        ]
    )
