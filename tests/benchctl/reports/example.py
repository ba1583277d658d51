"""A calibration result like those that a campaign brings, made without any fit: block means of a known gyro."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.calibration.result import (
    BeforeAfter,
    CalibrationResult,
    Contribution,
    FittedParameter,
    JointFit,
    MeanPoints,
    Noise,
    PolynomialFactor,
    Residuals,
    RunErrors,
    Share,
    SmootherFacts,
    Stage,
    StraightLine,
    TemperaturePoint,
    ValidRange,
)
from benchctl.recordings.model import BenchFacts, Meta, StepInfo, Unit

FloatArray = npt.NDArray[np.float64]

K0, U0, S, T0 = 0.05, 0.012, 0.0045, 20.0
G, C, DELAY = (-1.315e-4, 2.066e-6), (2e-5, -1.5e-7), 1.125e-3
STRAIGHT = 0.0497
BLOCK_S = 0.04
PARAMETERS = (
    ("K0_v_per_dps", K0, "V/(°/s)", 4e-7, "scale factor at T0 for small rates"),
    ("S_rad_per_dps", S, "rad/(°/s)", 2e-8, "interferometer's phase per rate"),
    ("g1", G[0], "1/°C", 2e-7, "scale factor over temperature, first order"),
    ("g2", G[1], "1/°C²", 5e-9, "scale factor over temperature, second order"),
    ("U0_v", U0, "V", 8e-5, "output at rest at T0"),
    ("c1", C[0], "V/°C", 1.1e-6, "bias over temperature, first order"),
    ("c2", C[1], "V/°C²", 3e-8, "bias over temperature, second order"),
    ("delay_s", DELAY, "s", 9e-7, "gyro behind the encoder"),
    ("encoder_cos1_arcsec", -9.0, "″", 0.2, "encoder's error, once per revolution"),
)


@dataclass(frozen=True, slots=True)
class Run:
    """One step of the campaign."""

    kind: str
    temperature: float
    rate: float
    frequency: float = 0.0
    role: str = "fit"
    seconds: float = 30.0


def runs(temperatures: int, *, verify: bool) -> list[Run]:
    """A sweep at T0, low rates at every temperature, sines at some."""
    setpoints = np.linspace(-40, 60, temperatures) if temperatures > 1 else np.array([T0])
    found = [Run("static", T0, 0.0)]
    found += [Run("constant_rate", T0, sign * rate) for rate in range(10, 180, 10) for sign in (1, -1)]
    found += [Run("sine", T0, 165.0, hz) for hz in (0.25, 0.5, 1.0)]
    for i, temperature in enumerate(setpoints):
        found.append(Run("static", temperature, 0.0))
        found += [Run("constant_rate", temperature, sign * rate) for rate in range(10, 60, 10) for sign in (1, -1)]
        if i % 4 == 0:
            found += [Run("sine", temperature, 165.0, hz) for hz in (0.25, 0.5, 1.0)]
        if verify and (i % 4 == 2 or temperatures == 1):
            found += [Run("sine", temperature, 165.0, hz, "verify") for hz in (0.4, 0.8)]
    return found


def volts(rate: FloatArray, temperature: FloatArray | float) -> FloatArray:
    """The gyro's output without noise."""
    dt = np.asarray(temperature) - T0
    gain = K0 / S * (1 + G[0] * dt + G[1] * dt**2)
    return np.asarray(U0 + C[0] * dt + C[1] * dt**2 + gain * np.sin(S * rate))


def example(
    temperatures: int = 20, *, verify: bool = True, joint: bool = True
) -> tuple[CalibrationResult, list[StepInfo]]:
    """A result and its steps."""
    asked, rng = runs(temperatures, verify=verify), np.random.default_rng(1)
    infos: list[StepInfo] = []
    columns: dict[str, list[FloatArray]] = {
        name: [] for name in ("step", "verify", "time", "rate", "acc", "temp", "volts")
    }
    clock = 0.0
    for index, run in enumerate(asked, 1):
        if index == 1 or run.temperature != asked[index - 2].temperature:
            clock += 5400.0
        n = round(run.seconds / BLOCK_S) if run.kind == "sine" else 1
        t = (np.arange(n) + 0.5) * BLOCK_S
        omega = 2 * np.pi * run.frequency
        rate = run.rate * np.sin(omega * t) if omega else np.full(n, run.rate)
        acceleration = run.rate * omega * np.cos(omega * t)
        temperature = np.full(n, run.temperature + 0.002 * rng.standard_normal())
        scatter = 1.1e-4 if omega else 2e-5
        output = volts(rate - DELAY * acceleration, temperature) + scatter * rng.standard_normal(n)
        values = (
            np.full(n, index),
            np.full(n, run.role == "verify"),
            clock + t,
            rate,
            acceleration,
            temperature,
            output,
        )
        for name, value in zip(columns, values, strict=True):
            columns[name].append(value)
        infos.append(_info(index, run, clock))
        clock += run.seconds + 8.0
    flat = {name: np.concatenate(parts) for name, parts in columns.items()}
    left = _residuals(flat, joint=joint)
    return _result(asked, infos, flat, left, temperatures), infos


def _residuals(flat: dict[str, FloatArray], *, joint: bool) -> dict[str, FloatArray]:
    dt, late = flat["temp"] - T0, flat["rate"] - DELAY * flat["acc"]
    x = (flat["volts"] - U0 - C[0] * dt) / K0
    first = x * (1 - G[0] * dt - 2.2e-6 * dt**2) * (1 + 3.02e-6 * x**2 + 5.89e-11 * x**4)
    second = first * (1 + 2e-7 * dt) * (1 - 2e-8 * first**2)
    left = {
        "raw": (flat["volts"] - U0) / STRAIGHT - flat["rate"],
        "stage_1": first - flat["rate"],
        "stage_2": second - late,
    }
    if joint:
        gain = K0 * (1 + G[0] * dt + G[1] * dt**2)
        left["joint"] = np.arcsin(S * (flat["volts"] - U0 - C[0] * dt - C[1] * dt**2) / gain) / S - late
    return left


def _info(index: int, run: Run, clock: float) -> StepInfo:
    return StepInfo(
        index=index,
        name=f"{run.kind} {index}",
        kind=run.kind,
        role=run.role,
        t_start=clock,
        t_end=clock + run.seconds,
        chamber_setpoint_c=run.temperature,
        rate_dps=run.rate if run.kind == "constant_rate" else None,
        amplitude_dps=run.rate if run.kind == "sine" else None,
        frequency_hz=run.frequency or None,
        sample_rate_hz=500.0,
        samples=round(run.seconds * 500),
    )


def _result(
    asked: list[Run],
    infos: list[StepInfo],
    flat: dict[str, FloatArray],
    left: dict[str, FloatArray],
    temperatures: int,
) -> CalibrationResult:
    step = flat["step"].astype(np.int64)
    errors = []
    for info, run in zip(infos, asked, strict=True):
        mine = step == info.index
        if run.rate:
            per_cent = {name: 100 * np.abs(values[mine]) / abs(run.rate) for name, values in left.items()}
            errors.append(
                RunErrors(
                    step=info.index,
                    name=info.name,
                    kind=run.kind,
                    role=run.role,
                    temperature_c=run.temperature,
                    peak_rate_dps=abs(run.rate),
                    error_percent={name: float(values.max()) for name, values in per_cent.items()},
                    rms_percent={name: float(np.sqrt(np.mean(values**2))) for name, values in per_cent.items()},
                )
            )
    kept = [run for run in errors if run.role == "verify"]
    worst = {name: max(run.error_percent[name] for run in kept) for name in left} if kept else {}
    return CalibrationResult(
        unit="SIM-0001",
        range_dps=175.0,
        output_unit="V",
        T0_c=T0,
        latitude_deg=58.5,
        earth_rate_dps=0.003562,
        raw=StraightLine(K0_v_per_dps=STRAIGHT, U0_v=U0, rate_limit_dps=40.0),
        stages=_stages(worst, temperatures),
        joint=_joint() if "joint" in left else (),
        error_percent=worst,
        rms_percent={name: max(run.rms_percent[name] for run in kept) for name in left} if kept else {},
        runs=tuple(errors),
        residuals=Residuals(
            step=step,
            verify=flat["verify"].astype(np.bool_),
            time_s=flat["time"],
            rate_dps=flat["rate"],
            acceleration_dps2=flat["acc"],
            temperature_c=flat["temp"],
            block_s=np.full(step.size, BLOCK_S),
            residual_dps=left,
        ),
        points=_points(infos, asked, flat, step),
        temperatures=tuple(_temperature(t) for t in sorted({run.temperature for run in asked})),
        valid=ValidRange(rate_dps=(-170.0, 170.0), temperature_c=(min(flat["temp"]), max(flat["temp"]))),
        smoother=SmootherFacts(
            window_s=0.04, attenuation=1.2e-5, rate_noise_dps=0.0021, says="quartic over 21 samples"
        ),
        samples=sum(info.samples for info in infos),
        samples_masked=17,
        warnings=() if kept else ("No run was kept aside for verification: no error_percent is stated.",),
        notes=("The encoder's eccentricity was fitted together with the gyro.",),
    )


def _points(
    infos: list[StepInfo], asked: list[Run], flat: dict[str, FloatArray], step: npt.NDArray[np.int64]
) -> MeanPoints:
    steady = np.array([asked[i - 1].kind != "sine" for i in step])
    n = int(steady.sum())
    return MeanPoints(
        step=step[steady],
        time_s=flat["time"][steady],
        rate_dps=flat["rate"][steady],
        temperature_c=flat["temp"][steady],
        setpoint_c=np.round(flat["temp"][steady]),
        output_v=flat["volts"][steady],
        output_se_v=np.full(n, 2e-5),
        samples=np.full(n, infos[0].samples),
        revolutions=np.ones(n),
        verify=np.zeros(n, dtype=np.bool_),
    )


def _temperature(celsius: float) -> TemperaturePoint:
    dt = celsius - T0
    return TemperaturePoint(
        temperature_c=celsius,
        slope_v_per_dps=STRAIGHT * (1 + G[0] * dt + G[1] * dt**2) * (1 + 1e-6 * np.sin(celsius)),
        slope_standard=6e-7,
        bias_v=U0 + C[0] * dt + C[1] * dt**2 + 2e-5 * float(np.cos(celsius)),
        bias_standard=2e-5,
        rates=10,
        rate_limit_dps=50.0,
    )


def _stages(worst: dict[str, float], temperatures: int) -> tuple[Stage, ...]:
    bends = PolynomialFactor(
        basis=("ω²", "ω⁴"), coefficients=(3.02e-6, 5.89e-11), covariance=((1e-18, -4e-23), (-4e-23, 2.5e-27))
    )
    warm = PolynomialFactor(basis=(), coefficients=(), covariance=())
    if temperatures > 1:
        warm = PolynomialFactor(
            basis=("ΔT", "ΔT²"), coefficients=(1.315e-4, -2.066e-6), covariance=((4e-14, -6e-16), (-6e-16, 2.5e-17))
        )

    def before_after(first: str, then: str) -> BeforeAfter:
        return BeforeAfter(before=worst.get(first), after=worst.get(then))

    line = {"K0_v_per_dps": K0, "U0_v": U0, "u0_t": (2e-5, -1.5e-7)}
    first = Stage(
        name="stage 1", k_t=warm, k_omega=bends, **line, delay_s=0.0,  # type: ignore[arg-type]
        error_percent=before_after("raw", "stage_1"), rms_percent=before_after("raw", "stage_1"), runs=231,
    )  # fmt: skip
    second = Stage(
        name="stage 2",
        k_t=PolynomialFactor(basis=("ΔT",), coefficients=(8.3e-7,), covariance=((4e-14,),)),
        k_omega=PolynomialFactor(basis=("ω²",), coefficients=(1.77e-8,), covariance=((1e-18,),)),
        **line,  # type: ignore[arg-type]
        delay_s=DELAY,
        standard={"K0_v_per_dps": 5e-7, "U0_v": 9e-5, "delay_s": 1e-6},
        error_percent=before_after("stage_1", "stage_2"),
        rms_percent=before_after("stage_1", "stage_2"),
        shares=(
            Share(part="delay", share=0.71, alone=0.66),
            Share(part="K0", share=0.22, alone=0.3),
            Share(part="k(ω)", share=0.06, alone=0.1),
            Share(part="k(T)", share=0.01, alone=0.01),
        ),
        runs=21,
    )
    return first, second


def _joint() -> tuple[JointFit, ...]:
    parameters = tuple(
        FittedParameter(
            name=name,
            value=value,
            unit=unit,
            standard=standard,
            ci95=(value - 1.96 * standard, value + 1.96 * standard),
            says=says,
            expanded=(2.0 if name.startswith("encoder") else 2.2) * standard,
            budget=()
            if name.startswith("encoder")
            else (
                Contribution(
                    source="scatter of the data", standard=standard, kind="A", says="covariance of the joint fit"
                ),
                Contribution(source="thermometer", standard=0.4 * standard, kind="B", says="0.1 °C, uniform"),
            ),
        )
        for name, value, unit, standard, says in PARAMETERS
    )
    return (
        JointFit(
            law="sine",
            convention="response",
            argument="true",
            parameters=parameters,
            covariance=np.diag([parameter.standard**2 for parameter in parameters]),
            noise=Noise(white_v=5e-4, random_walk_v_per_sqrt_s=5e-7, mean_excess=1.04),
            rows=16012,
            bic=16321.0,
        ),
    )


def meta(status: str = "complete", serial: str = "SIM-0001") -> Meta:
    """The description of the recording."""
    instruments = {
        "rate_table": {
            "manufacturer": "Acutronic", "model": "ACUTROL3000", "serial": "AC-1234", "firmware": "4.1",
            "bench_serial": "AC-1234", "calibrated_until": "2027-01-31", "driver": "acutrol3000",
        },
        "digitizer": {"manufacturer": "LabJack", "model": "T7", "serial": "470012345", "driver": "labjack_t7"},
    }  # fmt: skip
    return Meta(
        status=status,  # type: ignore[arg-type]
        unit=Unit(serial=serial, range_dps=175.0, model="VG910Q (assumed figures)"),
        bench=BenchFacts(
            sample_rate_hz=500.0,
            encoder_counts_per_rev=360000,
            encoder_accuracy_arcsec=20.0,
            adc_bits=16,
            adc_range_v=10.0,
            latitude_deg=58.5,
        ),
        provenance={
            "procedure": "two_stage",
            "procedure_sha256": "ab" * 32,
            "parameters": json.dumps({"points": 20, "room_c": 20.0, "sine_hz": [0.25, 0.5, 1.0]}),
            "bench": "simulated bench",
            "bench_toml": 'name = "simulated bench"\n# <all> of it\n',
            "bench_physics": json.dumps({"seed": 1}),
            "instruments": json.dumps(instruments),
            "software": json.dumps({"benchctl": "0.1.0", "python": "3.11.9", "numpy": "2.1.0"}),
            "operator": "A. Engineer",
            "started_utc": "2026-03-04T05:06:07+00:00",
        },
    )
