"""Records of known noise, made without the code under test."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def nbs14(count: int) -> FloatArray:
    """The test suite of NIST SP 1065, section 12.4: so many numbers of a prime modulus generator."""
    numbers = [1234567890]
    while len(numbers) < count:
        numbers.append(16807 * numbers[-1] % 2147483647)
    return np.array(numbers) / 2147483647


def flicker(chance: np.random.Generator, count: int, interval_s: float) -> FloatArray:
    """Samples of two-sided density 1/(2πf), that is of B = 1, shape (count,); from the middle of a longer record."""
    longer = 8 * count
    frequency_hz = np.fft.rfftfreq(longer, interval_s)
    density = np.zeros_like(frequency_hz)
    density[1:] = 1.0 / (2.0 * np.pi * frequency_hz[1:])
    real, imaginary = chance.standard_normal((2, frequency_hz.size))
    lines = (real + 1j * imaginary) * np.sqrt(density * longer / (2.0 * interval_s))
    return np.asarray(np.fft.irfft(lines, longer)[:count])


def record(
    chance: np.random.Generator, count: int, interval_s: float, q: float = 0, n: float = 0, b: float = 0, k: float = 0
) -> FloatArray:
    """Rates with these coefficients, in units of the rate and seconds, shape (count,)."""
    rates = n * chance.standard_normal(count) / np.sqrt(interval_s)
    if q:
        rates += q * np.diff(chance.standard_normal(count + 1)) / interval_s
    if b:
        rates += b * flicker(chance, count, interval_s)
    if k:
        rates += k * np.cumsum(chance.standard_normal(count)) * np.sqrt(interval_s)
    return rates
