"""The straight line through a thermistor's samples over time, gathered part by part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class TemperatureLine:
    """Sums over parts, each about its own means, so that nothing is lost to large stamps."""

    def __init__(self) -> None:
        self._sums: list[tuple[float, float, float, float, float]] = []

    def take(self, time_s: FloatArray, readings_c: FloatArray | None) -> None:
        """More samples, (n,) each; None where there is no thermistor. Readings that are not finite are left out."""
        if readings_c is None:
            return
        good = np.isfinite(readings_c)
        if not good.all():
            time_s, readings_c = time_s[good], readings_c[good]
        if time_s.size:
            mean_s, centred = float(time_s.mean()), time_s - time_s.mean()
            about = float(centred @ centred), float(centred @ readings_c)
            self._sums.append((float(time_s.size), mean_s, float(readings_c.mean()), *about))

    def fitted(self) -> tuple[float, float]:
        """Intercept at time 0 of the recording, °C, and slope, °C/s; NaN and 0 where there are no two readings."""
        if sum(part[0] for part in self._sums) < 2:
            return np.nan, 0.0
        count, mean_s, mean_c, squares, products = np.array(self._sums).T
        middle_s, middle_c = np.average(mean_s, weights=count), np.average(mean_c, weights=count)
        apart = count * (mean_s - middle_s)
        slope = float((products.sum() + apart @ (mean_c - middle_c)) / (squares.sum() + apart @ (mean_s - middle_s)))
        return float(middle_c - slope * middle_s), slope
