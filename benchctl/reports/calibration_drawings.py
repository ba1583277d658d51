"""The figures of a calibration report with their captions, and in words for who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from benchctl.calibration.result import CalibrationResult
from benchctl.reports import text
from benchctl.reports.figures import Drawing, inline_svg, level_names, style
from benchctl.reports.law_figures import k_omega_figure, k_temperature_figure, output_figure
from benchctl.reports.path_figures import levels_figure, residual_rows_figure, shown_runs
from benchctl.reports.residual_figures import final_residuals_figure, last_level


def drawings(result: CalibrationResult) -> Mapping[str, Drawing]:
    """The figures that the result supports, by name: levels, rows, final, output, k_omega, k_temperature."""
    found: dict[str, Drawing] = {}

    def add(name: str, figure: Figure | None, alt: str, caption: str) -> None:
        if figure is not None:
            found[name] = Drawing(svg=inline_svg(figure, name), alt=alt, caption=caption)

    with style():
        level = last_level(result)
        if level is not None and shown_runs(result):
            add("levels", levels_figure(result), _levels_alt(result), _levels_caption(result))
        if level is not None:
            add("rows", residual_rows_figure(result), _rows_alt(result), _rows_caption(result))
            add("final", final_residuals_figure(result, level), _final_alt(), _final_caption(result))
        t0 = text.plain(result.T0_c, "°C")
        add(
            "output",
            output_figure(result),
            f"Output of the gyro against rate at {t0} and its distance from a straight line.",
            f"Left: output against rate at {t0}, means of steps at constant rate. Right: the same less the straight "
            f"line that was fitted up to ±{text.plain(result.raw.rate_limit_dps, '°/s')}, as a rate.",
        )
        add(
            "k_omega",
            k_omega_figure(result),
            f"Correction k of the indicated rate against the indicated rate at {t0}.",
            f"k(ω) is the number by which the rate that stage 1's K0 indicates at {t0} is to be multiplied, the bias "
            "being taken from the readings at rest. "
            "Bands: 95 % intervals of the curves by the scatter of the data; where none is seen it is narrower than "
            "the line.",
        )
        add(
            "k_temperature",
            k_temperature_figure(result),
            "Correction k and bias of the gyro against temperature.",
            f"Left: k(T), 1 at T0 = {t0}; the points are slopes of output against rate at one temperature each. "
            "Right: output at rest; the joint fit's curve is that of the moment when the recording began, while the "
            "points have wandered with the bias since. Bands and bars: 95 % intervals by the scatter of the data.",
        )
    return found


def _levels_alt(result: CalibrationResult) -> str:
    told = [f"{level.replace('_', ' ')} {text.percent(value)}" for level, value in result.error_percent.items()]
    return "Largest error of each level against rate, temperature and time" + (f": {', '.join(told)}." if told else ".")


def _levels_caption(result: CalibrationResult) -> str:
    kept = any(run.role == "verify" for run in shown_runs(result))
    which = "the runs kept aside for verification" if kept else "the fitted runs themselves, as none was kept aside"
    return (
        f"The path of the error on {which}, in percent of the largest rate of each run, on a logarithmic scale. "
        "Left: the largest error of all blocks within a bin of rate. Others: the largest error of each run."
    )


def _rows_alt(result: CalibrationResult) -> str:
    levels = ", ".join(level.replace("_", " ") for level in level_names(tuple(result.residuals.residual_dps)))
    return (
        f"Error in °/s against rate, temperature and time, one row for each of: {levels}. The scale shrinks row by row."
    )


def _rows_caption(result: CalibrationResult) -> str:
    left = result.residuals
    colours = "Coloured: runs kept aside; grey: fitted runs. " if left.verify.any() else ""
    return (
        "Compensated less true rate, one point a block; each row has its own scale. "
        f"{colours}Of many points those drawn include the highest and lowest everywhere."
    )


def _final_alt() -> str:
    return "What the final model leaves, against rate and acceleration, with means in bins, and its distribution."


def _final_caption(result: CalibrationResult) -> str:
    kept = "the runs kept aside" if result.residuals.verify.any() else "all runs"
    return (
        f"What the last level leaves of {kept}. A model that says all leaves noise: no shape in the means, and a "
        "distribution like the normal one. A slope against acceleration would be an error of timing."
    )
