"""Matrix of scale factors and misalignment, biases and their dependence on temperature of a unit of three axes.

    y = M·Ω + b + (M'·Ω + b')·(T − T0) + h·cos θ + h'·sin θ

with y the stated rates, Ω the rate about the axes of the housing, T the temperature that the unit states and θ the
table's angle. In each position one axis of the unit is vertical, so that Ω has one component, ±(ω + Ω_E·sin φ): the
encoder's rate and the vertical part of the Earth's at the latitude φ. That position determines one column of M. The
horizontal part of the Earth's rate and a tilt of the table's axis turn with the unit; h and h' of each position contain
them. Without a latitude the vertical part is fitted, for each output.

Rows are means over short blocks of constant rates and of rests. The standard uncertainties follow from the scatter of
the steps and not only from the noise within them (`estimation.linear.clustered_covariance`): a scale factor that
depends on the rate, and a bias that changes from one mounting to the next, widen them. The axes are those of the
fixture: its errors of angle are part of M.

The columns of M are those of Ferraris, Grimaldi and Parvis ("Procedure for effortless in-field calibration of
three-axial rate gyro and accelerometers", Sensors and Materials 7, 1995), whose K·R is M; there the angle of a whole
turn takes the place of the encoder, and the Earth's rate is neglected.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchctl.calibration.coefficients import THREE_AXES_SCHEMA
from benchctl.calibration.uncertainty import LEVEL, coverage_factor
from benchctl.estimation.linear import clustered_covariance, fit_linear
from benchctl.recordings.model import Meta, Step
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import gap_free
from benchctl.signals.rate import unwrap_deg
from benchctl.signals.step_reduction import QUIET_KINDS, samples_in_block
from benchctl.signals.under_test import AXIS_RATES
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import AXES, AXIS_POSITIONS, vertical
from benchctl_instruments.physics.gyro import earth_rate_dps

_LEAST_SPREAD_C = 2.0
"""Temperatures of each axis must differ by more than this for a dependence on temperature to be fitted."""
_LEAST_SINGULAR = 1e-3
"""Smallest singular value of the normalised columns over the largest; the encoder's noise alone makes a tenth of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesLaw:
    """A matrix (3, 3), whose rows are outputs and whose columns are axes, and biases (3,) [deg/s]."""

    matrix: FloatArray
    bias_dps: FloatArray

    def numbers(self) -> Iterator[tuple[str, float, str]]:
        """Yield name, value and unit of every number: `matrix_xy` is the output x for a rate about y."""
        for output, row, bias_dps in zip(AXES, self.matrix, self.bias_dps, strict=True):
            yield from ((f"matrix_{output}{about}", float(value), "1") for about, value in zip(AXES, row, strict=True))
            yield f"bias_{output}_dps", float(bias_dps), "deg/s"


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesEstimate:
    """Values, their standard uncertainties, and the degrees of freedom of these."""

    value: AxesLaw
    standard: AxesLaw
    dof: AxesLaw

    @property
    def expanded(self) -> AxesLaw:
        """Expanded uncertainties, 95.45 %."""
        factor = np.vectorize(coverage_factor, otypes=[np.float64])
        return AxesLaw(
            matrix=factor(self.dof.matrix) * self.standard.matrix,
            bias_dps=factor(self.dof.bias_dps) * self.standard.bias_dps,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisParameter:
    """One number of the result with its standard uncertainty."""

    name: str
    value: float
    standard: float
    dof: float
    unit: str

    @property
    def k(self) -> float:
        """The coverage factor of the expanded uncertainty, 95.45 %."""
        return coverage_factor(self.dof)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreeAxesResult:
    """The law at T0 and its change per °C, None if the temperatures do not differ.

    `temperature_c` and `rate_dps` are the ranges that were measured, `positions` those of the unit, `steps` the number
    of steps.
    """

    at_T0: AxesEstimate  # noqa: N815 - the field's own letters
    per_c: AxesEstimate | None
    T0_c: float
    temperature_c: tuple[float, float]
    rate_dps: tuple[float, float]
    positions: tuple[str, ...]
    steps: int
    latitude_deg: float | None
    warnings: tuple[str, ...]

    def parameters(self) -> Iterator[AxisParameter]:
        """Yield every number of `AxesLaw.numbers`, then those per °C."""
        for estimate, suffix, per in ((self.at_T0, "", ""), (self.per_c, "_per_c", "/°C")):
            if estimate is None:
                continue
            laws = (law.numbers() for law in (estimate.value, estimate.standard, estimate.dof))
            for (name, value, unit), (_, standard, _), (_, dof, _) in zip(*laws, strict=True):
                full, unit = f"{name}{suffix}", f"{unit}{per}"
                yield AxisParameter(name=full, value=value, standard=standard, dof=dof, unit=unit)


def turned_steps(recording: Recording) -> list[int]:
    """Return the complete steps, at rest or at a constant rate, of a unit of three axes with an axis up or down."""
    return [
        info.index
        for info in recording.infos
        if info.whole
        and info.kind in QUIET_KINDS
        and info.mounting in AXIS_POSITIONS
        and set(AXIS_RATES) <= set(recording.channels(info.index))
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """Block means, shape (n,); `output_dps` and `along_dps`, the rate about each axis of the unit, have shape (n, 3).

    `heading` are the means of cosine and sine of the table's angle, shape (n, 2).
    """

    count: FloatArray
    step: IntArray
    position: IntArray
    rate_dps: FloatArray
    heading: FloatArray
    celsius: FloatArray
    output_dps: FloatArray


def fit_three_axes(steps: Iterable[Step], meta: Meta) -> ThreeAxesResult:
    """Fit the law to steps of `turned_steps` as `signals.under_test` presents them; raises `UsageError`."""
    rows = _joined([part for step in steps for part in _rows_of(step)])
    known = meta.bench.latitude_deg is not None
    earth_dps = earth_rate_dps(meta.bench.latitude_deg) if meta.bench.latitude_deg is not None else 0.0
    axis, sign = np.array([vertical(position) for position in AXIS_POSITIONS])[rows.position].T
    along = np.where(axis[:, np.newaxis] == np.arange(3), (sign * (rows.rate_dps + earth_dps))[:, np.newaxis], 0.0)
    T0_c = float(np.round(np.average(rows.celsius, weights=rows.count)))
    law = np.column_stack([along, np.ones(axis.size)])
    spread_c = [np.ptp(rows.celsius[axis == each]) if (axis == each).any() else 0.0 for each in range(3)]
    drifts = min(spread_c) > _LEAST_SPREAD_C
    terms = [law, law * (rows.celsius - T0_c)[:, np.newaxis]] if drifts else [law]
    there = np.unique(rows.position)
    columns = np.column_stack([*terms, *(rows.heading * (rows.position == each)[:, np.newaxis] for each in there)])
    positions = tuple(AXIS_POSITIONS[each] for each in there)
    _refuse_unknown(columns, positions)
    weight = np.sqrt(rows.count)[:, np.newaxis]
    found = np.empty((3, 3, 4 * len(terms)))  # values, standard uncertainties and their degrees of freedom
    for output in range(3):
        own = columns if known else np.column_stack([columns, sign * (axis == output)])
        fit = fit_linear(own * weight, rows.output_dps[:, output] * weight[:, 0])
        covariance, dof = clustered_covariance(own * weight, fit.residual, rows.step)
        numbers = (fit.coefficients, np.sqrt(np.diag(covariance)), dof)
        found[:, output] = [of_all[: found.shape[2]] for of_all in numbers]
    return ThreeAxesResult(
        at_T0=_estimate(found[..., :4]),
        per_c=_estimate(found[..., 4:]) if drifts else None,
        T0_c=T0_c,
        temperature_c=(float(rows.celsius.min()), float(rows.celsius.max())),
        rate_dps=(float(rows.rate_dps.min()), float(rows.rate_dps.max())),
        positions=positions,
        steps=int(np.unique(rows.step).size),
        latitude_deg=meta.bench.latitude_deg,
        warnings=() if known else (_NO_LATITUDE,),
    )


_NO_LATITUDE = (
    "the latitude is not known, so the vertical part of the Earth's rate was fitted, too, which widens the uncertainty "
    "of the biases; state site.latitude_deg in bench.toml"
)


def three_axes_coefficients(result: ThreeAxesResult, *, unit: str, source: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return the content of `coefficients.json`; `source` is the name and the digest of each recording."""
    found = {"": result.at_T0, "_per_c": result.per_c}
    return {
        "schema": THREE_AXES_SCHEMA,
        "unit": unit,
        "output_unit": "deg/s",
        "law": "output = (matrix + matrix_per_c·(T − T0))·rate + bias_dps + bias_dps_per_c·(T − T0)",
        "axes": list(AXES),
        "T0_c": result.T0_c,
        **{f"matrix{at}": one.value.matrix.tolist() for at, one in found.items() if one is not None},
        **{f"bias_dps{at}": one.value.bias_dps.tolist() for at, one in found.items() if one is not None},
        "valid": {"rate_dps": list(result.rate_dps), "temperature_c": list(result.temperature_c)},
        "uncertainty": {
            "k": 2,
            "level": LEVEL,
            "of": "scatter of the steps",
            "parameters": {
                one.name: {
                    "value": one.value,
                    "unit": one.unit,
                    "standard": one.standard,
                    "expanded": one.k * one.standard,
                    "k": one.k,
                    "dof": one.dof,
                }
                for one in result.parameters()
            },
        },
        "latitude_deg": result.latitude_deg,
        "positions": list(result.positions),
        "steps": result.steps,
        "source": [{"recording": name, "digest": digest} for name, digest in source],
        "warnings": list(result.warnings),
    }


def _estimate(found: FloatArray) -> AxesEstimate:
    value, standard, dof = (AxesLaw(matrix=each[:, :3], bias_dps=each[:, 3]) for each in found)
    return AxesEstimate(value=value, standard=standard, dof=dof)


def _refuse_unknown(columns: FloatArray, positions: tuple[str, ...]) -> None:
    lengths = np.linalg.norm(columns, axis=0)
    sizes = np.linalg.svd(columns / np.maximum(lengths, 1e-300), compute_uv=False)
    if sizes[-1] < _LEAST_SINGULAR * sizes[0]:
        raise UsageError(
            "three axes: expected each of x, y and z up or down, there at rest and at rates over complete revolutions, "
            f"found {', '.join(positions)}; run the procedure three_axes, or name all its recordings"
        )


def _joined(parts: Sequence[_Rows]) -> _Rows:
    if not parts:
        raise UsageError("three axes: no step has a valid sample of all three axes; see the journal for the faults")
    return _Rows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in _Rows.__slots__})


def _rows_of(step: Step) -> Iterator[_Rows]:
    """Yield the block means of each stretch without a gap; samples that one axis does not state as valid are gaps."""
    output = np.column_stack([step[name] for name in AXIS_RATES])
    good = np.isfinite(output).all(axis=1)
    time_s, angle_deg, celsius = (step[name][good] for name in ("time_s", "encoder_deg", "gyro_temp_c"))
    output, info = output[good], step.info
    celsius = np.where(np.isfinite(celsius), celsius, info.chamber_setpoint_c)
    if time_s.size < 2:
        return
    interval_s = float(np.median(np.diff(time_s)))
    for run in gap_free(time_s, interval_s):
        length = run.stop - run.start
        if length < 2:
            continue
        size = max(2, samples_in_block(info.kind, None, abs(info.rate_dps or 0.0), length * interval_s, 1 / interval_s))
        edges = np.linspace(0, length, max(1, length // size) + 1).astype(np.int64)
        count = np.diff(edges).astype(np.float64)

        def mean(values: FloatArray, edges: IntArray = edges, count: FloatArray = count) -> FloatArray:
            found: FloatArray = (np.add.reduceat(values, edges[:-1], axis=0).T / count).T
            return found

        angle, lengths = unwrap_deg(angle_deg[run]), np.diff(edges)
        from_middle_s = time_s[run] - np.repeat(mean(time_s[run]), lengths)
        still = info.kind == "static"
        radians = np.radians(angle)
        yield _Rows(
            count=count,
            step=np.full(count.size, info.index),
            position=np.full(count.size, AXIS_POSITIONS.index(info.mounting)),
            rate_dps=np.zeros(count.size) if still else mean(from_middle_s * angle) / mean(from_middle_s**2),
            heading=mean(np.column_stack([np.cos(radians), np.sin(radians)])),
            celsius=mean(celsius[run]),
            output_dps=mean(output[run]),
        )
