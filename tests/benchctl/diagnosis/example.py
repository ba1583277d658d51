"""Diagnoses like those of a real recording, made without any search: every number and curve is written down here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.result import (
    Alternative,
    Diagnosis,
    Estimate,
    Finding,
    FitFigures,
    NextExperiment,
    NotFound,
    Slice,
    StepFigures,
    Trace,
    Unexplained,
    Where,
)

FloatArray = npt.NDArray[np.float64]

NOISE_V = 5.1e-4
THRESHOLD = 4.2
RANGES = {
    "time": (0.0, 3300.0),
    "rate": (-145.0, 145.0),
    "abs_rate": (0.0, 145.0),
    "rate_sign": (-1.0, 1.0),
    "acceleration": (-400.0, 400.0),
    "angle": (0.0, 360.0),
    "gyro_temp": (-20.0, 55.0),
    "gyro_temp_rate": (-0.06, 0.06),
    "chamber_temp": (-20.0, 55.0),
    "output": (-2.4, 2.4),
    "frequency": (0.05, 62.5),
    "step": (0.0, 60.0),
}

LAG = Finding(
    effect="thermal_lag",
    probability=0.99,
    parameters={"tau_s": Estimate(value=590.8, low=575.1, high=606.5, unit="s")},
    where=Where(
        coordinate="gyro_temp_rate",
        ranges=((0.021, 0.058),),
        steps=("ramp to +55", "rate +145.0 at +55"),
        share_of_excess=0.93,
    ),
    explains=0.86,
    gain=4321.5,
    gain_heldout=811.2,
    says="The fibre coil is colder than its thermistor while the chamber heats: it lags by 591 s.",
    alternatives=(Alternative(effect="thermal_hysteresis", probability=0.01, loss=9.2),),
)
ECCENTRICITY = Finding(
    effect="encoder_eccentricity",
    probability=0.9999,
    parameters={
        "amplitude_arcsec": Estimate(value=80.17, low=79.2, high=81.1, unit="arcsec"),
        "phase_deg": Estimate(value=331.5, low=330.8, high=332.2, unit="degree"),
        "order": Estimate(value=1.0, low=1.0, high=1.0, unit="1"),
    },
    where=Where(coordinate="angle", ranges=((20.0, 95.0), (200.0, 275.0)), share_of_excess=0.71),
    explains=0.12,
    gain=640.2,
    gain_heldout=152.0,
    says="The encoder is wrong by 80.2 arcsec, once a turn: its rate seems to change with the angle.",
)
NEXT = NextExperiment(
    says="Soak cold, then ramp up and down again at a constant rate: a lag is symmetrical, a hysteresis is not.",
    procedure="temperature_sweep",
    separates=("thermal_lag", "thermal_hysteresis"),
    parameters={"points": 3},
    separation=58.4,
)
BASELINE = {
    "K0_v_per_dps": Estimate(value=0.0160032, low=0.0160029, high=0.0160035, unit="V/(deg/s)", was=0.016),
    "U0_v": Estimate(value=0.01203, low=0.01199, high=0.01207, unit="V", was=0.012),
    "k_T_1": Estimate(value=1.316e-4, low=1.311e-4, high=1.321e-4, unit="1/degC", was=1.315e-4),
    "delay_s": Estimate(value=2.1e-5, low=-4e-6, high=4.6e-5, unit="s"),
}


def pair() -> Diagnosis:
    """A thermal lag and an eccentric encoder, both found, nothing else left."""
    return Diagnosis(
        recording="pair",
        part="gyro",
        verdict="missing-physics",
        says="Two effects are missing in the model, a lag of temperature and an eccentric encoder; with them it agrees "
        "to within the noise.",
        baseline=BASELINE,
        findings=(LAG, ECCENTRICITY),
        unexplained=Unexplained(significant=False, share=0.004, says="What is left is noise in every coordinate."),
        fit=FitFigures(
            unit="V",
            noise=NOISE_V,
            before=2.71e-3,
            after=5.13e-4,
            heldout_before=1.94e-3,
            heldout_named=5.16e-4,
            heldout_after=5.16e-4,
        ),
        next_experiment=NEXT,
        not_found=(
            NotFound(effect="dead_zone", parameter="half_width_dps", smallest=0.0123, unit="degree s-1"),
            NotFound(
                effect="scale_warm_up",
                parameter="fraction",
                smallest=2.1e-5,
                unit="1",
                others={"tau_s": 600.0},
            ),
        ),
        slices=_slices(left=False),
        steps=_steps(),
        traces=_traces(),
        notes=("No step turns slower than 4 deg/s: a dead zone below 2 deg/s cannot be told from a bias.",),
        model={
            "format": "benchctl-model/1",
            "recording": "pair",
            "simulation": {"K0_v_per_dps": 0.0160032, "U0_v": 0.01203, "T0_c": 23.0},
            "effects": {"thermal_lag": {"tau_s": 590.8}},
        },
        threshold=21.7,
        seed=0,
    )


def nothing_missing() -> Diagnosis:
    """The model agrees as it stands."""
    return replace(
        pair(),
        recording="null",
        verdict="consistent",
        says="The model agrees with the recording to within the noise.",
        findings=(),
        fit=FitFigures(
            unit="V",
            noise=NOISE_V,
            before=5.13e-4,
            after=5.12e-4,
            heldout_before=5.16e-4,
            heldout_named=5.16e-4,
            heldout_after=5.16e-4,
        ),
        unexplained=Unexplained(significant=False, share=0.0),
        next_experiment=NextExperiment(says="Nothing is open."),
    )


def unknown_structure() -> Diagnosis:
    """Something that no effect accounts for is left along the angle."""
    return replace(
        pair(),
        recording="odd",
        verdict="unknown-structure",
        says="The residual is not noise, and no known effect accounts for it.",
        findings=(),
        unexplained=Unexplained(
            significant=True,
            share=0.62,
            coordinates=("angle", "angle*gyro_temp"),
            says="What is left repeats 17 times a turn and grows with temperature; no known effect does that.",
        ),
        slices=_slices(left=True),
    )


def _slices(left: bool) -> tuple[Slice, ...]:
    rng = np.random.default_rng(5)
    return tuple(_slice(name, low, high, rng, left) for name, (low, high) in RANGES.items())


def _slice(name: str, low: float, high: float, rng: np.random.Generator, left: bool) -> Slice:
    bins = {"rate_sign": 3, "frequency": 20}.get(name, 24)
    edges = np.geomspace(low, high, bins + 1) if name == "frequency" else np.linspace(low, high, bins + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    count = rng.integers(2000, 20000, bins).astype(np.float64)
    if name == "abs_rate":
        count[5] = 0.0
    error = NOISE_V / np.sqrt(np.maximum(count, 1.0))
    shape = {
        "gyro_temp_rate": 2e-3 * middle / 0.06,
        "gyro_temp": 4e-4 * np.sin(middle / 12.0),
        "angle": 3e-4 * np.cos(np.radians(middle - 331.0)),
        "time": 6e-4 * np.sin(middle / 400.0),
    }.get(name, np.zeros(bins))
    chance = error * rng.standard_normal(bins)
    after = chance + (1e-4 * np.cos(np.radians(17 * middle)) if left and name == "angle" else 0.0)
    mean = np.where(count > 0, shape + chance, np.nan)
    return Slice(
        coordinate=name,
        edges=edges,
        count=count,
        before=mean,
        after=np.where(count > 0, after, np.nan),
        standard_error=np.where(count > 0, error, np.nan),
        threshold=THRESHOLD,
    )


def _steps() -> tuple[StepFigures, ...]:
    rng = np.random.default_rng(6)
    found = []
    for index in range(60):
        moving = index % 12 != 0
        lagging = 1.0 + 4.0 * moving * (index % 17) / 17
        found.append(
            StepFigures(
                name=f"rate {10 * (index % 12):+d} at +23" if moving else "static +23",
                kind="constant_rate" if moving else "static",
                t_start=55.0 * index,
                t_end=55.0 * index + 40.0,
                heldout=index % 5 == 2,
                as_it_came=NOISE_V * (lagging + 1.5 * moving),
                before=NOISE_V * lagging,
                after=NOISE_V * (1.0 + 0.02 * rng.standard_normal()),
            )
        )
    return tuple(found)


def _traces() -> tuple[Trace, ...]:
    rng = np.random.default_rng(7)
    time_s = np.arange(0.0, 8.0, 0.008)
    found = []
    for name, offset_v in (("ramp to +55", 2.0e-3), ("sine 100 at 0.5 Hz at -20", 1.1e-3)):
        after: FloatArray = 1.6 * np.sin(2 * np.pi * 0.5 * time_s)
        measured = after + NOISE_V * rng.standard_normal(time_s.size)
        found.append(
            Trace(
                step=name,
                heldout=True,
                time_s=600.0 + time_s,
                measured=measured,
                before=after * (1 + offset_v) + offset_v / 2,
                after=after,
                spoilt=np.zeros(time_s.size, np.bool_),
            )
        )
    return tuple(found)
