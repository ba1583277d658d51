"""The simulated bench without any wire: a table, a chamber and a gyro on terminals, sharing one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

# The physics load these when they first need them; that takes a second, which a client would wait in vain.
import scipy.signal
import scipy.special  # noqa: F401

from benchctl_instruments.interfaces import Position
from benchctl_instruments.physics.chain import GRID_STAGES, Effect
from benchctl_instruments.simulated.axis import TableAxis
from benchctl_instruments.simulated.climate import ClimateChamber
from benchctl_instruments.simulated.clock import BenchClock
from benchctl_instruments.simulated.installation import Installation
from benchctl_instruments.simulated.machines import AnalogInputs, ChamberMachine, TableMachine
from benchctl_instruments.simulated.sensor import sensor_of
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.terminals import Terminals
from benchctl_instruments.simulated.timebase import Timebase

OTHER_NOISE = 1 << 32
"""What is added to the seed for the noise of a second gyro."""


class World:
    """The bench's physics behind `benchctl_instruments.simulated.machines`, safe from any thread.

    Nothing is computed until it is asked for. Motion and temperatures are known in closed form between demands, so that
    a jump of hours costs no more than one of a second; only what is sampled runs through the gyro's electronics,
    instant by instant. The same settings, demands and samples give the same volts.

    Parameters
    ----------
    clock
        Bench time.
    settings
        What the bench obeys; the defaults where none are given.
    effects
        Physics beside the baseline, by stage of `benchctl_instruments.physics.chain`.
    """

    def __init__(
        self, clock: BenchClock, settings: WorldSettings | None = None, effects: Sequence[Effect] = ()
    ) -> None:
        self.clock = clock
        self.settings = settings or WorldSettings()
        timebase = Timebase(clock, self.settings.grid_hz)
        axis = TableAxis(timebase, self.settings.table)
        sensor = sensor_of(self.settings)
        climate = ClimateChamber(
            timebase, self.settings.chamber, self.settings.room_c, coil_is_housing=sensor.coil_is_housing
        )
        self.table: TableMachine = axis
        self.chamber: ChamberMachine = climate
        self._installation = Installation(timebase)
        self.inputs: AnalogInputs = Terminals(
            timebase, self.settings, sensor, axis, climate, self._installation, effects
        )
        self._timebase, self._axis, self._climate, self._effects = timebase, axis, climate, tuple(effects)

    def power(self, on: bool) -> None:
        """Switch the gyro's supply: off it puts out 0 V, and on again it comes up anew, and warms up anew."""
        self._installation.power(on)

    def mount(self, position: Position) -> None:
        """Mount the gyro with its input axis along or across the table's."""
        self._installation.mount(position)

    def second_gyro(self) -> AnalogInputs:
        """The inside of another gyro of the same make on the same table: the same law, noise of its own.

        Of the effects it has those up to the electronics; what befalls samples is the digitizer's. Whoever reads it
        changes nothing of what `inputs` give.
        """
        settings = replace(self.settings, seed=self.settings.seed + OTHER_NOISE)
        inside = [effect for effect in self._effects if effect.stage in GRID_STAGES]
        time = self._timebase.beside()
        return Terminals(time, settings, sensor_of(settings), self._axis, self._climate, self._installation, inside)
