"""The words of a calibration report: formulas, conventions, remarks, how to do it again."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping

import numpy as np

from benchctl.calibration.result import CalibrationResult, JointFit
from benchctl.recordings.model import Meta
from benchctl.reports import text
from benchctl.reports.path_figures import shown_runs
from benchctl.reports.setup_section import parameters

_EXCESS = 3.0
"""Beyond this the scatter of the means is no matter of chance."""

_CONVENTIONS: Mapping[tuple[str, str], str] = {
    ("correction", "indicated"): "correction, of the indicated rate: the rate that the line reads is multiplied by k",
    ("response", "true"): "response, to the true rate: the law says what the gyro puts out; it is inverted for use",
}


def formula(joint: JointFit) -> list[str]:
    """How an output U becomes a rate ω by a joint fit, in lines."""
    names = {parameter.name for parameter in joint.parameters}
    bias = "U − U0" + "".join(f" − {c}·{_power('ΔT', i)}" for i, c in enumerate(("c1", "c2", "c3"), 1) if c in names)
    letter = "g" if joint.law == "sine" else "a"
    terms = [f"{letter}{i}" for i in range(1, 5) if f"{letter}{i}" in names]
    warm = "".join(f" + {term}·{_power('ΔT', i)}" for i, term in enumerate(terms, 1))
    bends = [(f"b{i}", i) for i in (2, 4, 6, 8) if f"b{i}" in names]
    if joint.law == "sine":
        gain = f"(K0·(1{warm}))" if warm else "K0"
        return [f"x = ({bias}) / {gain}", "ω = arcsin(S·x) / S"]
    warm_factor = f"·(1{warm})" if warm else ""
    if joint.law == "response":
        bend = "".join(f" + {name}·{_power('ω', i)}" for name, i in bends)
        return [f"{bias} = K0{warm_factor}·(1{bend})·ω, solved for ω"]
    bend = "·(1" + "".join(f" + {name}·{_power('x', i)}" for name, i in bends) + ")" if bends else ""
    return [f"x = ({bias}) / K0", f"ω = x{warm_factor}{bend}"]


def conventions(result: CalibrationResult) -> list[tuple[str, str]]:
    """Terms and what they mean in this report."""
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
        told = _CONVENTIONS.get((best.convention, best.argument), f"{best.convention}, argument {best.argument}")
        rows.append((f"Law of the joint fit ({best.law})", f"{told}."))
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
    """What a user of the coefficients should know, and what was done."""
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
    """The commands that repeat the campaign and the fit."""
    procedure = meta.provenance.get("procedure")
    lines = []
    if procedure:
        chosen = [f"-p {shlex.quote(f'{name}={_argument(value)}')}" for name, value in parameters(meta).items()]
        lines.append(" ".join(["benchctl run", shlex.quote(procedure), "--bench bench.toml", *chosen]))
    return "\n".join(
        [*lines, "benchctl verify RECORDING     # the digest above", "benchctl fit RECORDING        # this report"]
    )


def _argument(value: object) -> str:
    """A parameter as the command line takes it."""
    return ",".join(str(item) for item in value) if isinstance(value, list) else str(value)


def _true_rate(result: CalibrationResult) -> str:
    told = "the rate of the table by its encoder"
    if result.latitude_deg is not None:
        told += f" plus the vertical part of the Earth's, {text.number(result.earth_rate_dps, 3)} °/s at this latitude"
    if result.smoother is None:
        return f"{told}."
    noise = result.smoother.rate_noise_dps
    known = f" Noise of one value: {text.number(noise, 2)} °/s." if math.isfinite(noise) else ""
    return f"{told}. {text.raised(result.smoother.says)}{known}"


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
        "run, in percent; of several runs the largest. Only runs in motion that no fit has seen count. From stage 2 on "
        "the fitted delay is applied."
    )


def _power(base: str, exponent: int) -> str:
    return base if exponent == 1 else base + "⁰¹²³⁴⁵⁶⁷⁸⁹"[exponent]
