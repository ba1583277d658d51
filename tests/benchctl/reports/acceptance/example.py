"""An acceptance made by hand: a test of each fate, and texts that somebody hostile wrote."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path

import numpy as np

from benchctl.bench import template
from benchctl.metrology.result import (
    Acceptance,
    Column,
    Contribution,
    Judged,
    Limit,
    Measured,
    Papers,
    Picture,
    Rule,
    Trace,
    Uncertainty,
    message,
)
from benchctl.recordings.model import BenchFacts, Meta, StepInfo, Unit
from benchctl.reports.acceptance.build import report_of
from benchctl.reports.acceptance.document import Report
from benchctl.reports.acceptance.set_up import RecordingFacts
from benchctl.reports.coefficient_tables import Coefficient

HOSTILE = "<script>alert('1')</script>&\"\x00\u202e日本"
LOGO = "iVBORw0KGgoAAAANSUhEUgAAAAgAAAAECAIAAAA8r+mnAAAAFElEQVR4nGNkKNjEgA0wYRUlSwIAcEYBKozAPygAAAAASUVORK5CYII="
"""A PNG image of 8 by 4 pixels, in base64."""
RATES = np.linspace(-150.0, 150.0, 31)
STEPS = tuple(range(1, 41))
DIGESTS = {index: hashlib.sha256(str(index).encode()).hexdigest() for index in STEPS}


def uncertainty(standard: float, says: str = "gum_agrees") -> Uncertainty:
    shares = (0.82, 0.45, 0.3, 0.15, 0.01, 0.0)
    sources = ("scatter", "encoder", "converter's gain", "clock", "thermometer", "mounting")
    origins = (
        "scatter of the readings, drift of the bias included",
        "±20″ stated, uniform",
        "certificate D-2026-7.1, k = 2",
        "certificate D-2026-7.1, k = 2",
        "assumed",
        "not known, taken as none",
    )
    scale = standard / float(np.linalg.norm(shares))
    parts = tuple(
        Contribution(source=source, standard=share * scale, kind="A" if source == "scatter" else "B", says=origin)
        for source, share, origin in zip(sources, shares, origins, strict=True)
    )
    return Uncertainty(
        standard=standard,
        expanded=2.0 * standard,
        monte_carlo=1.97 * standard,
        contributors=parts,
        says=message(says, difference_percent=1.4 if says == "gum_agrees" else 12.0),
    )


def scale_factor() -> Measured:
    output_v = 0.05 * RATES + 0.012 - 4e-8 * RATES**3
    fit = np.polyval(np.polyfit(RATES, output_v, 1), RATES)
    left = 1e6 * (output_v - fit) / np.abs(output_v).max()
    return Measured(
        name="scale_factor",
        unit="mV/(deg/s)",
        value=49.7013,
        uncertainty=uncertainty(0.0021),
        temperature_c=20.13,
        steps=STEPS[:31],
        table=(
            Column(name="rate", unit="deg/s", values=tuple(RATES.tolist())),
            Column(name="output", unit="V", values=tuple(output_v.tolist())),
            Column(name="misfit", unit="ppm", values=tuple(left.tolist())),
        ),
        picture=Picture(
            x="rate",
            x_unit="deg/s",
            y="output",
            y_unit="V",
            traces=(Trace(label="readings", x=RATES, y=output_v), Trace(label="line", x=RATES, y=fit, dots=False)),
            left=(Trace(label="misfit", x=RATES, y=left),),
            left_unit="ppm",
        ),
    )


def angle_random_walk() -> Measured:
    tau_s = np.geomspace(0.01, 400.0, 47)
    sigma = np.hypot(3.0 / np.sqrt(tau_s), 0.4)
    return Measured(
        name="angle_random_walk",
        unit="deg/sqrt(h)",
        value=0.0502,
        uncertainty=uncertainty(0.0009),
        temperature_c=20.0,
        steps=(32,),
        notes=(message("gaps", count=2, step=32), message("mean_of", seconds=10.0, count=360)),
        table=(
            Column(name="tau", unit="s", values=tuple(tau_s.tolist())),
            Column(name="allan_deviation", unit="deg/h", values=tuple(sigma.tolist())),
        ),
        picture=Picture(
            x="tau",
            x_unit="s",
            y="allan_deviation",
            y_unit="deg/h",
            traces=(
                Trace(label="allan_deviation", x=tau_s, y=sigma),
                Trace(label="terms", x=tau_s, y=3.0 / np.sqrt(tau_s), dots=False),
            ),
            logarithmic=True,
        ),
    )


def judged() -> tuple[Judged, ...]:
    refused = Measured(name="misalignment", unit="mrad", refused=message("needs_across"))
    return (
        Judged(measured=scale_factor(), limit=Limit(low=49.5, high=50.5, unit="mV/(deg/s)"), verdict="PASS"),
        Judged(
            measured=Measured(
                name="nonlinearity_reading",
                unit="%",
                value=1.31,
                uncertainty=uncertainty(0.02, "size_of_changes"),
                temperature_c=20.1,
                steps=(*STEPS[:5], 36),
                notes=(message("line_up_to", limit_dps=40.0),),
            ),
            limit=Limit(low=None, high=1.0, unit="%"),
            verdict="FAIL",
        ),
        Judged(
            measured=Measured(
                name="bias",
                unit="deg/h",
                value=-98.9,
                uncertainty=uncertainty(2.1),
                temperature_c=20.1,
                steps=(32, 33),
                notes=(message("earth_taken_off", rate_deg_per_h=12.824),),
            ),
            limit=Limit(low=-100.0, high=100.0, unit="deg/h"),
            verdict="INCONCLUSIVE",
            remedy=message("longer", times=4.0, source="scatter"),
        ),
        Judged(measured=angle_random_walk(), limit=Limit(low=None, high=0.06, unit="deg/sqrt(h)"), verdict="PASS"),
        Judged(
            measured=refused,
            limit=Limit(low=-5.0, high=5.0, unit="mrad"),
            verdict="INCONCLUSIVE",
            remedy=message("run_procedure", procedure="misalignment"),
        ),
        Judged(
            measured=Measured(
                name="input_range", unit="deg/s", value=150.0, bound="at least", uncertainty=uncertainty(0.01)
            ),
            limit=None,
            verdict=None,
        ),
        Judged(
            measured=Measured(
                name="bias_temperature_rate", unit="(deg/h)/(degC/min)", value=3.1, uncertainty=uncertainty(0.5)
            ),
            limit=None,
            verdict=None,
        ),
        Judged(
            measured=Measured(name="bandwidth", unit="Hz", refused=message("needs_sines", found=0, needed=4)),
            limit=None,
            verdict=None,
        ),
        Judged(
            measured=Measured(
                name="rate_ramp",
                unit="(deg/h)/h",
                refused=message("term_refused", why="its slope lies outside the record, or below the other terms"),
            ),
            limit=None,
            verdict=None,
        ),
    )


def acceptance(**changes: object) -> Acceptance:
    values: dict[str, object] = {
        "verdict": "FAIL",
        "rule": Rule(guard=1.0, says=message("rule_guarded", guard=1.0, risk_percent=2.3)),
        "judged": judged(),
        "papers": Papers(
            number="17-2026",
            revision="2",
            customer="АО «Заказчик»",
            standard="ТУ 6635-001",
            stage="after vibration",
            firmware="2.1.0",
        ),
        "limits_name": "limits.toml",
        "limits_text": "guard = 1.0",
        "limits_sha256": hashlib.sha256(b"limits").hexdigest(),
        "anomalies": (
            message("certificate_expired", role="chamber", model="Watlow F4T", date="2026-06-30"),
            message("not_complete", status="interrupted"),
        ),
        "step_digests": DIGESTS,
    }
    return Acceptance(**(values | changes))  # type: ignore[arg-type]


def _info(index: int) -> StepInfo:
    rate_dps = float(RATES[index - 1]) if index <= RATES.size else None
    return StepInfo(
        index=index,
        name="rest" if rate_dps is None else f"rate {rate_dps:+g}",
        kind="static" if rate_dps is None else "constant_rate",
        role="none" if index == 35 else "fit",
        whole=index != 35,
        t_start=100.0 * index,
        t_end=100.0 * index + (3600.0 if index == 32 else 30.0),
        chamber_setpoint_c=20.0 if index < 36 else -40.0,
        rate_dps=rate_dps,
        sample_rate_hz=500.0,
        samples=15_000,
        gaps=2 if index == 32 else 0,
        digest=DIGESTS[index],
    )


def facts(serial: str = "VG-0917", **changes: object) -> RecordingFacts:
    instruments = {
        "rate_table": {
            "manufacturer": "Acutronic",
            "model": "ACUTROL 3000",
            "bench_serial": "AC-1234",
            "calibrated_until": "2027-01-31",
            "certificate": "LNE 2026-123",
        },
        "chamber": {"model": "Watlow F4T", "serial": "CH-77", "calibrated_until": "2026-06-30", "certificate": "45"},
        "digitizer": {"model": "LabJack T7", "serial": "470012345", "calibrated_until": ""},
    }
    values: dict[str, object] = {
        "path": Path("results/20261120-180000_acceptance_VG-0917/recording.h5"),
        "meta": Meta(
            status="complete",
            unit=Unit(serial=serial, range_dps=150.0, model="VG910Q"),
            bench=BenchFacts(
                sample_rate_hz=500.0,
                encoder_counts_per_rev=360_000,
                encoder_accuracy_arcsec=20.0,
                adc_bits=16,
                adc_range_v=10.0,
                latitude_deg=58.5,
            ),
            provenance={
                "procedure": "acceptance",
                "parameters": json.dumps({"points": 3, "soak_s": 1800.0}),
                "procedure_sha256": hashlib.sha256(b"procedure").hexdigest(),
                "instruments": json.dumps(instruments),
                "software": json.dumps({"benchctl": "0.1.0", "python": "3.11.7", "numpy": "2.3.1"}),
                "operator": "Ö. Ångström",
                "bench": "стенд 2",
                "bench_toml": template() + '\n[laboratory]\nname = "Gyro laboratory"\naddress = "Optics street 1"\n',
                "laboratory_logo": LOGO,
                "started_utc": "2026-11-20T18:00:00+00:00",
            },
        ),
        "infos": tuple(_info(index) for index in STEPS),
        "digest": hashlib.sha256(b"recording").hexdigest(),
        "deviations": ("The chamber's door was opened for a minute after step 12.",),
        "coefficients": (
            Coefficient(
                name="K0_v_per_dps",
                symbol="K0",
                value=0.05,
                stated="(50.001 ± 0.012) mV/(°/s)",
                interval="",
                says="scale factor at low rates",
            ),
        ),
    }
    return RecordingFacts(**(values | changes))  # type: ignore[arg-type]


@cache
def report(language: str) -> Report:
    """The report on it, whose pictures are drawn once for page and PDF."""
    return report_of(acceptance(), facts(), language)
