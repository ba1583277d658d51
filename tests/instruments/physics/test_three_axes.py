"""A unit of three axes: what its axes sense in each position, and what it puts out."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import AXIS_POSITIONS, AxisPosition, vertical
from benchctl_instruments.physics.gyro import EARTH_DPS
from benchctl_instruments.physics.three_axes import ThreeAxisParameters, sensed_rates_dps

ANGLES_DEG = np.array([0.0, 90.0, 215.0])
STILL = np.zeros(3)


@pytest.mark.parametrize("position", AXIS_POSITIONS)
def test_in_every_position_the_vertical_axis_senses_the_table_and_the_others_do_not(position: AxisPosition) -> None:
    axis, sign = vertical(position)
    turned = sensed_rates_dps(position, np.full(3, 40.0), ANGLES_DEG, 50.0)
    rested = sensed_rates_dps(position, STILL, ANGLES_DEG, 50.0)
    np.testing.assert_allclose((turned - rested)[:, axis], sign * 40.0)
    np.testing.assert_array_equal(np.delete(turned - rested, axis, axis=1), 0.0)


@pytest.mark.parametrize("position", AXIS_POSITIONS)
def test_at_rest_the_three_axes_together_sense_all_of_the_earths_rate(position: AxisPosition) -> None:
    sensed = sensed_rates_dps(position, STILL, ANGLES_DEG, 50.0)
    np.testing.assert_allclose(np.linalg.norm(sensed, axis=1), EARTH_DPS)
    assert abs(sensed[0, vertical(position)[0]]) == pytest.approx(EARTH_DPS * np.sin(np.radians(50.0)))


def test_the_axes_stay_right_handed_when_the_unit_is_turned_over() -> None:
    """Seen from the unit, the north goes round the axis that is up against the table's turning, and with it if down."""
    for position in AXIS_POSITIONS:
        axis, sign = vertical(position)
        first, second = sensed_rates_dps(position, STILL, np.array([0.0, 90.0, 0.0]), 0.0)[:2]
        assert np.cross(first, second)[axis] == pytest.approx(-sign * EARTH_DPS**2)


def test_the_rows_of_the_matrix_are_outputs_and_change_with_temperature() -> None:
    unit = ThreeAxisParameters(
        matrix=(1.0, 0.1, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0),
        matrix_per_c=(0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0),
        bias_dps=(0.5, 0.0, 0.0),
        bias_dps_per_c=(0.0, 0.0, 0.02),
        T0_c=20.0,
    )
    output = unit.output_dps(np.array([[10.0, 20.0, 30.0], [10.0, 20.0, 30.0]]), np.array([20.0, 25.0]))
    np.testing.assert_allclose(output, [[12.5, 40.0, 90.0], [12.5, 40.5, 90.1]])


def test_a_matrix_that_is_too_short_is_refused() -> None:
    with pytest.raises(UsageError, match="matrix has 3 numbers; give 9"):
        ThreeAxisParameters(matrix=(1.0, 1.0, 1.0))
