"""The numbers of a compensation under the names of C macros, each with its unit in the name."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from benchctl.calibration.applied_law import AppliedLaw
from benchctl.calibration.compensating import Compensation
from benchctl.calibration.odd_inverse import reach


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """A macro: its value, what it is, and its expanded uncertainty where that is known."""

    name: str
    value: float
    says: str
    expanded: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StageNames:
    """The macros of one stage's coefficients, in the order of `Factors`."""

    k_t: tuple[str, ...]
    k_omega: tuple[str, ...]


def stage_names(law: AppliedLaw, index: int) -> StageNames:
    """How the coefficients of a stage are called; with its number where there are several."""
    stage = law.stages[index]
    prefix = f"GYRO_STAGE{index + 1}_K" if len(law.stages) > 1 else "GYRO_K"
    return StageNames(
        k_t=tuple(f"{prefix}_T{i + 1}_PER_C{i + 1}" for i in range(len(stage.k_t))),
        k_omega=tuple(f"{prefix}_W{2 * i + 2}_PER_DPS{2 * i + 2}" for i in range(len(stage.k_omega))),
    )


def constants(compensation: Compensation) -> Iterator[Constant]:
    """Every number that the functions of the header use, and those that its user should know."""
    law, expanded = compensation.law, compensation.expanded
    k0, u0, s = "K0_v_per_dps", "U0_v", "S_rad_per_dps"
    yield Constant(
        name="GYRO_K0_V_PER_DPS", value=law.K0_v_per_dps, says="V/(deg/s), scale factor", expanded=expanded.get(k0)
    )
    yield Constant(name="GYRO_U0_V", value=law.U0_v, says="V, output at rest", expanded=expanded.get(u0))
    if law.knows_temperature:
        yield Constant(name="GYRO_T0_C", value=law.T0_c, says="degC, dT counts from here")
    if law.name == "sine":
        yield Constant(
            name="GYRO_S_RAD_PER_DPS",
            value=law.S_rad_per_dps,
            says="rad/(deg/s), phase per rate",
            expanded=expanded.get(s),
        )
    for i, value in enumerate(law.bias, start=1):
        yield Constant(
            name=f"GYRO_U0_T{i}_V_PER_C{i}",
            value=value,
            says=f"V/degC^{i}, output at rest over dT^{i}",
            expanded=expanded.get(f"c{i}"),
        )
    for index in range(len(law.stages)):
        yield from _of_stage(compensation, index)
    yield from _limits(compensation)


def _of_stage(compensation: Compensation, index: int) -> Iterator[Constant]:
    law, expanded = compensation.law, compensation.expanded
    stage, names = law.stages[index], stage_names(law, index)
    letter = "g" if law.name == "sine" else "a"
    for i, (name, value) in enumerate(zip(names.k_t, stage.k_t, strict=True), start=1):
        yield Constant(name=name, value=value, says=f"degC^-{i}, of dT^{i}", expanded=expanded.get(f"{letter}{i}"))
    for i, (name, value) in enumerate(zip(names.k_omega, stage.k_omega, strict=True), start=1):
        power = 2 * i
        yield Constant(
            name=name, value=value, says=f"(deg/s)^-{power}, of rate^{power}", expanded=expanded.get(f"b{power}")
        )


def _limits(compensation: Compensation) -> Iterator[Constant]:
    law, valid = compensation.law, compensation.valid
    if law.name == "response" and law.stages[0].k_omega:
        end, most = reach(law.stages[0].k_omega)
        yield Constant(name="GYRO_REACH_DPS", value=end, says="deg/s, beyond it the output tells no rate")
        yield Constant(name="GYRO_REACH_INDICATED_DPS", value=most, says="deg/s, what the gyro makes of that")
    yield Constant(
        name="GYRO_DELAY_S",
        value=law.delay_s,
        says="s, output behind motion",
        expanded=compensation.expanded.get("delay_s"),
    )
    slowest, fastest = valid.rate_dps
    yield Constant(name="GYRO_VALID_RATE_MIN_DPS", value=slowest, says="deg/s, measured from here")
    yield Constant(name="GYRO_VALID_RATE_MAX_DPS", value=fastest, says="deg/s, measured to here")
    coldest, warmest = valid.temperature_c
    if math.isfinite(coldest) and math.isfinite(warmest):
        yield Constant(name="GYRO_VALID_TEMPERATURE_MIN_C", value=coldest, says="degC, measured from here")
        yield Constant(name="GYRO_VALID_TEMPERATURE_MAX_C", value=warmest, says="degC, measured to here")
    yield Constant(name="GYRO_COVERAGE_FACTOR", value=compensation.k, says="their level is that of this k, 95.45 %")
