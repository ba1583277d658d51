"""The calibration report: one HTML page with the procedure, the results and their uncertainties."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from benchctl.calibration.result import CalibrationResult, JointFit
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import setup_section, text, verdict
from benchctl.reports.coefficient_tables import budget, joint_coefficients, stage_tables
from benchctl.reports.figures import PATH_LEVELS, Drawing, inline_svg, level_names, style
from benchctl.reports.html import render
from benchctl.reports.law_figures import (
    final_residuals_figure,
    k_omega_figure,
    k_temperature_figure,
    last_level,
    output_figure,
)
from benchctl.reports.path_figures import levels_figure, residual_rows_figure, run_table, shown_runs
from benchctl.reports.setup_section import parameters


def drawings(result: CalibrationResult) -> Mapping[str, Drawing]:
    """Draw the figures that the result supports, by name: levels, rows, final, output, k_omega, k_temperature."""
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
            alt = (
                "What the final model leaves, against rate and acceleration, with means in bins, and its distribution."
            )
            add("final", final_residuals_figure(result, level), alt, _final_caption(result))
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
            "Bands: 95 % intervals of the curves from the scatter of the data; where the data show none, the band is "
            "narrower than the line.",
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
    errors = [f"{level.replace('_', ' ')} {text.percent(value)}" for level, value in result.error_percent.items()]
    return "Largest error of each level against rate, temperature and time" + (
        f": {', '.join(errors)}." if errors else "."
    )


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


def _final_caption(result: CalibrationResult) -> str:
    kept = "the runs kept aside" if result.residuals.verify.any() else "all runs"
    return (
        f"What the last level leaves of {kept}. A complete model leaves noise only: no shape in the means, and a "
        "distribution like the normal one. A slope against acceleration would be an error of timing."
    )


_EXCESS = 3.0
"""Above this ratio the scatter of the means is not explained by chance."""

_CONVENTIONS: Mapping[tuple[str, str], str] = {
    ("correction", "indicated"): "correction, of the indicated rate: the rate that the line reads is multiplied by k",
    ("response", "true"): "response, to the true rate: the law gives the output of the gyro; it is inverted for use",
}


def formula(joint: JointFit) -> list[str]:
    """Return the equations that convert an output U to a rate ω by a joint fit, one per line."""
    names = {parameter.name for parameter in joint.parameters}
    bias = "U − U0" + "".join(f" − c{i}·{text.power('ΔT', i)}" for i in range(1, 4) if f"c{i}" in names)
    letter = "g" if joint.law == "sine" else "a"
    terms = [f"{letter}{i}" for i in range(1, 5) if f"{letter}{i}" in names]
    warm = "".join(f" + {term}·{text.power('ΔT', i)}" for i, term in enumerate(terms, 1))
    bends = [(f"b{i}", i) for i in (2, 4, 6, 8) if f"b{i}" in names]
    if joint.law == "sine":
        gain = f"(K0·(1{warm}))" if warm else "K0"
        return [f"x = ({bias}) / {gain}", "ω = arcsin(S·x) / S"]
    warm_factor = f"·(1{warm})" if warm else ""
    if joint.law == "response":
        bend = "".join(f" + {name}·{text.power('ω', i)}" for name, i in bends)
        return [f"{bias} = K0{warm_factor}·(1{bend})·ω, solved for ω"]
    bend = "·(1" + "".join(f" + {name}·{text.power('x', i)}" for name, i in bends) + ")" if bends else ""
    return [f"x = ({bias}) / K0", f"ω = x{warm_factor}{bend}"]


def conventions(result: CalibrationResult) -> list[tuple[str, str]]:
    """Return the terms and symbols of this report with their definitions."""
    rows = [
        ("True rate ω", _true_rate(result)),
        ("T, T0", f"T is the gyro's own thermometer; T0 = {text.plain(result.T0_c, '°C', 3)}; k(T0) = 1."),
        (
            "Indicated rate x",
            "what a straight line reads: (output − bias)/K0. In stage 2 it is the rate that stage 1 gave.",
        ),
        ("k of the stages", f"{_CONVENTIONS['correction', 'indicated']}."),
    ]
    if result.joint:
        best = result.best
        description = _CONVENTIONS.get((best.convention, best.argument), f"{best.convention}, argument {best.argument}")
        rows.append((f"Law of the joint fit ({best.law})", f"{description}."))
    return [
        *rows,
        (
            "Valid",
            f"{_valid(result)}: where it was measured. Beyond, the coefficients are an extrapolation.",
        ),
        ("error_percent", _error_percent(result)),
        ("rms_percent", "the root of the mean squared residual of the run instead of its largest."),
        ("Delay τ", "by how much the gyro's output is later than the encoder's angle in the recording."),
        (
            "Uncertainty",
            "expanded (95.45 %) from a budget by contributor, k by its degrees of freedom; an interval “by scatter” "
            "holds what the data themselves show.",
        ),
    ]


def remarks(result: CalibrationResult) -> list[str]:
    """Return remarks for the user of the coefficients, and notes on how they were determined."""
    reach = max(abs(end) for end in result.valid.rate_dps)
    beyond = (
        f"Measured up to {text.plain(reach, '°/s')}; the gyro's rated range is ±{text.plain(result.range_dps, '°/s')}."
    )
    found = [beyond] if reach < 0.99 * result.range_dps else []
    if result.joint and result.best.noise.mean_excess > _EXCESS:
        found.append(
            f"The means of steps scatter {text.number(result.best.noise.mean_excess, 2)} times as much as the noise "
            "within them: the output holds something that the joint fit lacks. The uncertainties stand for its model."
        )
    return [*found, *(text.raised(note) for note in result.notes)]


def again(meta: Meta) -> str:
    """Return the commands that repeat the campaign and the fit."""
    procedure = meta.provenance.get("procedure")
    lines = []
    if procedure:
        chosen = [f"-p {shlex.quote(f'{name}={_argument(value)}')}" for name, value in parameters(meta).items()]
        lines.append(" ".join(["benchctl run", shlex.quote(procedure), "--bench bench.toml", *chosen]))
    return "\n".join(
        [*lines, "benchctl verify RECORDING     # the digest above", "benchctl fit RECORDING        # this report"]
    )


def _argument(value: object) -> str:
    """Return a parameter in the syntax of the command line."""
    return ",".join(str(item) for item in value) if isinstance(value, list) else str(value)


def _true_rate(result: CalibrationResult) -> str:
    description = "the rate of the table by its encoder"
    if result.latitude_deg is not None:
        description += (
            f" plus the vertical part of the Earth's, {text.number(result.earth_rate_dps, 3)} °/s at this latitude"
        )
    if result.smoother is None:
        return f"{description}."
    noise = result.smoother.rate_noise_dps
    known = f" Noise of one value: {text.number(noise, 2)} °/s." if math.isfinite(noise) else ""
    return f"{description}. {text.raised(result.smoother.says)}{known}"


def _valid(result: CalibrationResult) -> str:
    rates = text.span(*result.valid.rate_dps, "°/s")
    if not all(math.isfinite(end) for end in result.valid.temperature_c):
        return rates
    return f"{rates} and {text.span(*result.valid.temperature_c, '°C')}"


def _error_percent(result: CalibrationResult) -> str:
    steps = [run.step for run in shown_runs(result)]
    blocks = result.residuals.block_s[np.isin(result.residuals.step, steps)]
    averaged = (
        f", both averaged over the same {text.plain(1e3 * float(np.median(blocks)), 'ms')}" if blocks.size else ""
    )
    return (
        f"the largest difference between compensated and true rate in a run{averaged}, over the largest rate of that "
        "run, in percent; of several runs the largest. Only runs in held-out motion counts. From stage 2 on "
        "the fitted delay is applied."
    )


def calibration_page(result: CalibrationResult, meta: Meta, infos: Sequence[StepInfo], *, digest: str) -> str:
    """Return the page as text. The same input gives the same bytes."""
    best = result.joint[0] if result.joint else None
    lines = formula(best) if best else []
    output_unit = text.unit_text(result.output_unit)
    contributors = budget(best) if best else None
    return render(
        "calibration.html.j2",
        meta=meta,
        result=result,
        best=best,
        date=meta.provenance.get("started_utc", "")[:10],
        status=verdict.status_text(meta),
        cautions=verdict.cautions(meta, setup_section.cut_steps(infos)),
        simulated=verdict.is_simulated(meta),
        verdict=verdict.sentence(result),
        tiles=verdict.tiles(result),
        setup=setup_section.facts(meta, infos),
        instrument_rows=setup_section.instruments(meta),
        groups=setup_section.step_groups(infos, _uses(result)),
        drawings=drawings(result),
        output_unit=output_unit,
        scale_unit=text.scale_unit(output_unit),
        formula=lines,
        warm=any("ΔT" in line for line in lines),
        joint_rows=joint_coefficients(best) if best else [],
        others=[_other(joint, result) for joint in result.joint[1:]],
        stages=stage_tables(result),
        budget=contributors,
        budget_notes=[(one.name, "; ".join(one.says)) for one in contributors.sources] if contributors else [],
        runs=run_table(result, infos),
        level_names={level: verdict.level_name(result, level) for level in PATH_LEVELS},
        remarks=remarks(result),
        conventions=conventions(result),
        provenance_rows=setup_section.provenance(meta, digest),
        again=again(meta),
    )


def _uses(result: CalibrationResult) -> dict[int, str]:
    """Return the use of each step by index. A step may have been cut into fitted runs and held-out runs."""
    left = result.residuals
    fitted, aside = set(left.step[~left.verify].tolist()), set(left.step[left.verify].tolist())
    return {
        **dict.fromkeys(fitted, "fitted"),
        **dict.fromkeys(aside, "kept aside"),
        **dict.fromkeys(fitted & aside, "fitted; parts kept aside"),
    }


def _other(joint: JointFit, result: CalibrationResult) -> dict[str, object]:
    return {
        "law": joint.law,
        "difference": text.number(joint.bic - result.best.bic, 3),
        "error_percent": result.error_percent.get(f"joint_{joint.law}"),
        "rows": joint_coefficients(joint),
    }
