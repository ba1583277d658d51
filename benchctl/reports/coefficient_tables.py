"""Tables of coefficients with uncertainties, of the budget and of the stages."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from benchctl.calibration.result import CalibrationResult, JointFit, PolynomialFactor, Stage
from benchctl.calibration.uncertainty import coverage_factor
from benchctl.reports import text

_SYMBOLS: Mapping[str, str] = {
    "K0_v_per_dps": "K0",
    "S_rad_per_dps": "S",
    "U0_v": "U0",
    "delay_s": "τ",
    "thermal_lag_s": "τ of the coil",
}
_MOST_DOF = 1000.0
"""Degrees of freedom from this value on are printed as infinite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficient:
    """One row of a table of coefficients; `value` is unrounded, the other fields are text."""

    name: str
    symbol: str
    value: float
    stated: str
    interval: str
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetLine:
    """The contributions to one coefficient's uncertainty, in the order of the budget's sources; None if it has none."""

    symbol: str
    unit: str
    standards: tuple[float | None, ...]
    dof: str
    k: float
    expanded: float
    largest: int


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetSource:
    """A contributor of type A or B, with the basis of its value, which may differ between coefficients."""

    name: str
    kind: str
    says: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """All contributors, and their contribution to each coefficient."""

    sources: tuple[BudgetSource, ...]
    lines: tuple[BudgetLine, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTable:
    """A stage of the two-stage calibration with its printed coefficients."""

    stage: Stage
    coefficients: tuple[Coefficient, ...]


def joint_coefficients(joint: JointFit) -> list[Coefficient]:
    """Return the parameters of a joint fit, those of the encoder last; ± is the expanded uncertainty."""
    ordered = sorted(joint.parameters, key=lambda parameter: parameter.name.startswith("encoder"))
    return [
        Coefficient(
            name=parameter.name,
            symbol=symbol(parameter.name),
            value=parameter.value,
            stated=text.with_uncertainty(parameter.value, parameter.expanded, text.unit_text(parameter.unit)),
            interval=text.interval(*parameter.ci95),
            says=text.raised(parameter.says),
        )
        for parameter in ordered
    ]


def budget(joint: JointFit) -> Budget | None:
    """Return the budget of the parameters with contributors other than the scatter of the data; None without any."""
    stated = [parameter for parameter in joint.parameters if len(parameter.budget) > 1]
    sources: dict[str, BudgetSource] = {}
    for part in (part for parameter in stated for part in parameter.budget):
        known = sources.get(part.source)
        grounds = {**dict.fromkeys(known.says if known else ()), text.raised(part.says): None}
        sources[part.source] = BudgetSource(name=part.source, kind=part.kind, says=tuple(grounds))
    lines = []
    for parameter in stated:
        by_source = {part.source: part.standard for part in parameter.budget}
        standards = tuple(by_source.get(source) for source in sources)
        lines.append(
            BudgetLine(
                symbol=symbol(parameter.name),
                unit=text.unit_text(parameter.unit),
                standards=standards,
                dof=text.number(parameter.dof, 2) if parameter.dof < _MOST_DOF else "∞",
                k=parameter.k,
                expanded=parameter.expanded,
                largest=max(range(len(standards)), key=lambda i: standards[i] or 0.0),
            )
        )
    return Budget(sources=tuple(sources.values()), lines=tuple(lines)) if lines else None


def stage_tables(result: CalibrationResult) -> list[StageTable]:
    """Return the tables of the stages; ± is the expanded uncertainty from the scatter of the data."""
    return [
        StageTable(stage=stage, coefficients=tuple(_of_stage(stage, result.output_unit))) for stage in result.stages
    ]


def symbol(name: str) -> str:
    """Return a parameter's symbol in the formulas: `K0_v_per_dps` is K0, `encoder_cos1_arcsec` is encoder cos 1θ."""
    encoder = re.fullmatch(r"encoder_(sin|cos)(\d)_arcsec", name)
    return f"encoder, {encoder[1]} {encoder[2]}θ".replace(" 1θ", " θ") if encoder else _SYMBOLS.get(name, name)


def _of_stage(stage: Stage, output_unit: str) -> list[Coefficient]:
    volts = text.unit_text(output_unit)
    known = {name: (standard, stage.dof.get(name, math.inf)) for name, standard in stage.standard.items()}
    rows = [
        _row("K0", stage.K0_v_per_dps, known.get("K0_v_per_dps"), text.scale_unit(volts), "scale factor at T0"),
        _row("U0", stage.U0_v, known.get("U0_v"), volts, "output at rest at T0"),
    ]
    rows += [
        _row(f"U0(T), {text.power('ΔT', i)}", c, None, f"{volts}/{text.power('°C', i)}", "bias over temperature")
        for i, c in enumerate(stage.u0_t, 1)
    ]
    rows += _of_factor("k(T)", stage.k_t, "ΔT", "°C", range(1, 9))
    rows += _of_factor("k(ω)", stage.k_omega, "x", "(°/s)", range(2, 10, 2))
    if stage.delay_s or "delay_s" in known:
        rows.append(_row("τ", stage.delay_s, known.get("delay_s"), "s", "delay of the gyro behind the encoder"))
    return rows


def _of_factor(
    name: str, factor: PolynomialFactor, argument: str, argument_unit: str, exponents: Sequence[int]
) -> Iterator[Coefficient]:
    for i, (coefficient, exponent) in enumerate(zip(factor.coefficients, exponents, strict=False)):
        known = (float(factor.covariance[i][i]) ** 0.5, factor.dof) if factor.covariance else None
        term, unit = text.power(argument, exponent), f"1/{text.power(argument_unit, exponent)}"
        yield _row(f"{name}, {term}", coefficient, known, unit, f"coefficient of {term} in {name}")


def _row(name: str, value: float, known: tuple[float, float] | None, unit: str, says: str) -> Coefficient:
    """Return a row; `known` holds the standard uncertainty and its degrees of freedom."""
    standard, dof = known or (math.nan, math.inf)
    half = coverage_factor(dof, 0.95) * standard
    return Coefficient(
        name=name,
        symbol=name,
        value=value,
        stated=text.with_uncertainty(value, coverage_factor(dof) * standard, unit),
        interval=text.interval(value - half, value + half) if half > 0.0 else text.NOT_KNOWN,
        says=says,
    )
