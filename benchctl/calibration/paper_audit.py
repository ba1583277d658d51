"""Recompute the numbers of the paper.

D.V. Pavlov, "Methods of identification of a multiplicative error of a fiber-optical gyroscope", Novgorod State
University, 2015.

Five points are computed from its printed formulas. The numbers for comparison in the table come from a calibration of a
simulated VG910Q whose sine law has the S implied by the paper's polynomial. The paper's ω is interpreted as the
indicated rate x, unless stated otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.result import CalibrationOptions, CalibrationResult
from benchctl.recordings.model import Meta, Step
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.response_gyro import one_plus

K_T_1 = (1.315e-4, -2.066e-6)
K_OMEGA_1 = (3.02e-6, 5.89e-11)
K_T_2 = (8.315e-5,)
K_OMEGA_2 = (1.77e-7,)
ROOM_C = 20.0
SINE_RANGE_DPS = 160.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperPoint:
    """One point of the audit: the paper's claim, the computed numbers (by name with unit), and a verdict in words."""

    number: int
    claim: str
    computed: Mapping[str, float]
    verdict: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperRow:
    """A row of the table: a quantity as printed in the paper and in the repeated experiment (None: not available)."""

    quantity: str
    unit: str
    paper: str
    ours: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperAudit:
    """The audit: the five points and, if a recording was given, the table and its calibration."""

    points: tuple[PaperPoint, ...]
    rows: tuple[PaperRow, ...]
    result: CalibrationResult | None


def audit(steps: Iterable[Step] | None = None, meta: Meta | None = None) -> PaperAudit:
    """Return the five points; with the steps of a simulated campaign also the table of the repeated experiment."""
    points = (_low_rates(), _eight_to_ten(), _inverse_of_sine(), _room_temperature(), _second_stage())
    if steps is None or meta is None:
        return PaperAudit(points=points, rows=(), result=None)
    result = calibrate(steps, meta, CalibrationOptions())
    return PaperAudit(points=points, rows=_table(result), result=result)


def k_minus_one_percent(coefficients: tuple[float, ...], argument: float) -> float:
    """Return 100·(k − 1) of a factor at its argument: ω² for k(ω), T for k(T)."""
    return 100 * (float(one_plus(coefficients, np.array([argument]))[0]) - 1)


def indicated(rate_dps: FloatArray) -> FloatArray:
    """Return the x with x·k1(x) = ω: the gyro's indication at a true rate by the paper's stage-1 polynomial."""
    return np.array(
        [brentq(lambda x, w=w: x * one_plus(K_OMEGA_1, np.array([x * x]))[0] - w, -1e3, 1e3) for w in rate_dps]
    )


def implied_sine(range_dps: float = SINE_RANGE_DPS) -> tuple[float, float]:
    """Return S [rad/(°/s)] whose inverse sine best fits the printed k1(ω) for |x| ≤ range, and the misfit, percent."""
    x = np.linspace(1.0, range_dps, 400)
    printed = one_plus(K_OMEGA_1, x**2)

    def misfit(S: float) -> FloatArray:
        return np.asarray(np.arcsin(S * x) / (S * x) - printed)

    found = minimize_scalar(
        lambda S: float(np.sum((x * misfit(S)) ** 2)), bounds=(1e-3, 0.9 / range_dps), method="bounded"
    )
    return float(found.x), 100 * float(np.max(np.abs(misfit(float(found.x)))))


def _low_rates() -> PaperPoint:
    w = np.linspace(-40.0, 40.0, 161)
    slope = float(w @ indicated(w) / (w @ w))
    at_60 = 100 * (1 - float(indicated(np.array([60.0]))[0]) / (60 * slope))
    printed = k_minus_one_percent(K_OMEGA_1, 60.0**2)
    return PaperPoint(
        number=1,
        claim="Up to 60 °/s the departure from a line stays within 0.9 %.",
        computed={"k_as_printed_percent": printed, "with_slope_over_40_percent": at_60},
        verdict=(
            f"As printed k1(60 °/s) departs by {printed:.2f} %. With K0 a slope over ±40 °/s, as the "
            "text says, the departure "
            f"at 60 °/s is {at_60:.2f} %: that agrees, so K0 must be a slope over a range, not a tangent at rest."
        ),
    )


def _eight_to_ten() -> PaperPoint:
    low, high = (
        float(np.sqrt(brentq(lambda square, p=p: k_minus_one_percent(K_OMEGA_1, square) - p, 1.0, 1e5)))
        for p in (8.0, 10.0)
    )
    true = [float(x * one_plus(K_OMEGA_1, np.array([x * x]))[0]) for x in (low, high)]
    return PaperPoint(
        number=2,
        claim="Near the end of the range table and gyro differ by 8 to 10 %.",
        computed={
            "x_at_8_percent_dps": low,
            "x_at_10_percent_dps": high,
            "true_low_dps": true[0],
            "true_high_dps": true[1],
        },
        verdict=(
            f"k1 is 8 to 10 % at {low:.0f} to {high:.0f} °/s in the polynomial's argument, which are true rates of "
            f"{true[0]:.0f} to {true[1]:.0f} °/s if the argument is the indicated rate: the range of the experiment."
        ),
    )


def _inverse_of_sine() -> PaperPoint:
    S, misfit = implied_sine()
    return PaperPoint(
        number=3,
        claim="k(ω) = 1 + 3.02e-6·ω² + 5.89e-11·ω⁴ grows with the rate, as is characteristic of interferometers.",
        computed={"S_rad_per_dps": S, "largest_misfit_percent": misfit, "S2_over_6": S**2 / 6},
        verdict=(
            "An interferometer's output falls short of the line, so that k above 1 is a correction of the indicated "
            f"rate. It is the inverse of sin(Sω)/S with S = {S:.5f} rad/(°/s) to within {misfit:.2f} % up to "
            f"{SINE_RANGE_DPS:.0f} °/s."
        ),
    )


def _room_temperature() -> PaperPoint:
    first = k_minus_one_percent(K_T_1, ROOM_C)
    both = 100 * (float((one_plus(K_T_1, np.array([ROOM_C])) * one_plus(K_T_2, np.array([ROOM_C])))[0]) - 1)
    return PaperPoint(
        number=4,
        claim="k(T) = 1 + 1.315e-4·T − 2.066e-6·T², with K0 the scale factor at room temperature.",
        computed={"k1_at_20_c_percent": first, "k1_k2_at_20_c_percent": both},
        verdict=(
            f"Read with T in °C, k1 at {ROOM_C:g} °C departs from 1 by {first:.2f} % ({both:.2f} % with stage 2), half "
            "of what is claimed in the end. Here T − T0 is the argument and k(T0) is 1."
        ),
    )


def _second_stage() -> PaperPoint:
    rate = k_minus_one_percent(K_OMEGA_2, 150.0**2)
    hot = k_minus_one_percent(K_T_2, 85.0)
    # At room temperature k2(T) is part of K0, so the error is relative to it.
    room = rate
    both = 100 * ((1 + rate / 100) * (1 + hot / 100) - 1)
    return PaperPoint(
        number=5,
        claim="Stage 2 takes the error from 3–4 % to 0.7 %.",
        computed={"k2_omega_at_150_percent": rate, "at_150_and_20_c_percent": room, "at_150_and_85_c_percent": both},
        verdict=(
            f"Its coefficients move the result by at most {room:.2f} % at 150 °/s and 20 °C, {both:.2f} % at 85 °C; "
            "2.3 to 3.3 % are needed. Something else changed between the stages (K0, U0, a delay, the argument of k). "
            "Here K0, U0 and the delay are refitted with the polynomials, and each one's share is reported."
        ),
    )


def _table(result: CalibrationResult) -> tuple[PaperRow, ...]:
    """Compare the paper's numbers with those of the repeated experiment."""
    first = result.stages[0]
    second = result.stages[1] if len(result.stages) > 1 else None

    def at(values: tuple[float, ...], i: int) -> float | None:
        return values[i] if i < len(values) else None

    errors = result.error_percent
    sine = next((fit for fit in result.joint if fit.law == "sine"), None)
    rows = [
        PaperRow(quantity="error before", unit="%", paper="8–10", ours=errors.get("raw")),
        PaperRow(quantity="stage 1, k(ω), ω²", unit="(°/s)⁻²", paper="3.02e-6", ours=at(first.k_omega.coefficients, 0)),
        PaperRow(
            quantity="stage 1, k(ω), ω⁴", unit="(°/s)⁻⁴", paper="5.89e-11", ours=at(first.k_omega.coefficients, 1)
        ),
        PaperRow(quantity="stage 1, k(T), ΔT", unit="°C⁻¹", paper="1.315e-4", ours=at(first.k_t.coefficients, 0)),
        PaperRow(quantity="stage 1, k(T), ΔT²", unit="°C⁻²", paper="−2.066e-6", ours=at(first.k_t.coefficients, 1)),
        PaperRow(quantity="error after stage 1", unit="%", paper="3–4", ours=errors.get("stage_1")),
    ]
    if second is not None:
        rows += [
            PaperRow(quantity="stage 2, k(T), ΔT", unit="°C⁻¹", paper="8.315e-5", ours=at(second.k_t.coefficients, 0)),
            PaperRow(
                quantity="stage 2, k(ω), ω²", unit="(°/s)⁻²", paper="1.77e-7", ours=at(second.k_omega.coefficients, 0)
            ),
            PaperRow(quantity="stage 2, delay", unit="s", paper="not printed", ours=second.delay_s),
            PaperRow(quantity="error after stage 2", unit="%", paper="0.7", ours=errors.get("stage_2")),
        ]
    rows.append(
        PaperRow(
            quantity="S of the sine law",
            unit="rad/(°/s)",
            paper=f"{implied_sine()[0]:.5f} (implied)",
            ours=None if sine is None else sine.value("S_rad_per_dps"),
        )
    )
    rows.append(PaperRow(quantity="error, joint sine", unit="%", paper="not tried", ours=errors.get("joint_sine")))
    return tuple(rows)
