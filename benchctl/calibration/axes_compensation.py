"""The coefficients of a unit of three axes ready for use: rates about the axes of its housing from its three outputs.

    Ω = (M + M'·(T − T0))⁻¹·(y − b − b'·(T − T0))

with the names of `calibration.three_axes`. The inverse is that by Cramer's rule, as in the C header.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from benchctl.calibration.coefficients import AxesCoefficients, FromFile, checked_as, from_file
from benchctl.calibration.three_axes import AxesLaw
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_BLOCK = 65536
"""Samples at once: the matrices of each take many times the memory of its outputs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesCompensation(FromFile):
    """The compensation for the outputs of one unit of three axes.

    `at_T0` is the law at T0 and `per_c` its change per °C, 0 if none was fitted. The delay of the outputs is not part
    of the fit.
    """

    at_T0: AxesLaw  # noqa: N815 - the field's own letters
    per_c: AxesLaw
    T0_c: float

    by: ClassVar[Literal["three_axes"]] = "three_axes"
    words: ClassVar[str] = "matrix of three axes"
    output_unit: ClassVar[str] = "deg/s"
    delay_s: ClassVar[float | None] = None

    def rates_dps(self, outputs: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the rates about x, y and z, shape (3, n), for outputs, shape (3, n), at temperatures (n,).

        Not finite where the matrix has no inverse.
        """
        rates = np.empty(outputs.shape)
        for start in range(0, celsius.size, _BLOCK):
            part = slice(start, start + _BLOCK)
            (x, y, z), bias_dps = self._at(celsius[part])
            cofactors = np.stack([np.cross(one, other, axis=0) for one, other in ((y, z), (z, x), (x, y))])
            with np.errstate(divide="ignore", invalid="ignore"):
                determinant = (x * cofactors[0]).sum(axis=0)
                rates[:, part] = np.einsum("oan,on->an", cofactors, outputs[:, part] - bias_dps) / determinant
        return rates

    def outputs_dps(self, rates_dps: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the outputs, shape (3, n), for rates about x, y and z, shape (3, n), at temperatures (n,)."""
        matrix, bias_dps = self._at(celsius)
        outputs: FloatArray = np.einsum("oan,an->on", matrix, rates_dps) + bias_dps
        return outputs

    def self_test_points(self) -> list[tuple[list[float], float, list[float]]]:
        """Return outputs [deg/s], temperature [°C] and rates [deg/s] at the 16 corners of the valid range."""
        slowest, fastest = self.valid.rate_dps
        *wanted, celsius = np.array(list(product(*[(slowest, fastest)] * 3, self.valid.temperature_c))).T
        outputs = self.outputs_dps(np.array(wanted), celsius)
        rates = self.rates_dps(outputs, celsius)
        return list(zip(outputs.T.tolist(), celsius.tolist(), rates.T.tolist(), strict=True))

    def _at(self, celsius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the matrix, shape (3, 3, n), and the biases, shape (3, n), at temperatures (n,)."""
        at_T0, per_c, dt_c = self.at_T0, self.per_c, celsius - self.T0_c
        matrix = at_T0.matrix[..., np.newaxis] + per_c.matrix[..., np.newaxis] * dt_c
        return matrix, at_T0.bias_dps[:, np.newaxis] + per_c.bias_dps[:, np.newaxis] * dt_c


def axes_compensation(content: Mapping[str, Any], path: Path, sha256: str) -> AxesCompensation:
    """Return the compensation in the content of a file; raise `UsageError` if it cannot be used."""
    found = checked_as(AxesCoefficients, content, str(path))
    try:
        common = from_file(found, sha256)
    except UsageError as err:
        raise UsageError(f"{path}: {err}") from err
    return AxesCompensation(
        at_T0=AxesLaw(matrix=np.array(found.matrix), bias_dps=np.array(found.bias_dps)),
        per_c=AxesLaw(matrix=np.array(found.matrix_per_c), bias_dps=np.array(found.bias_dps_per_c)),
        T0_c=found.T0_c,
        **common,
    )
