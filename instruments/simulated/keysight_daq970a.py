"""A simulated Keysight DAQ970A with a DAQM901A multiplexer in slot 1: the 34970A's commands under another name."""

from __future__ import annotations

from benchctl_instruments.simulated.keysight_34970a import SimulatedMeter34970A
from benchctl_instruments.simulated.scanning_meter import MeterServer


class _Meter(SimulatedMeter34970A):
    IDENTITY = "Keysight Technologies,DAQ970A,MY00000001,A.03.02-01.00-01.00-00.02-02-01"


class SimulatedDAQ970A(MeterServer):
    """A DAQ970A at `tcp://host:port`; see `MeterServer`."""

    METER = _Meter


Twin = SimulatedDAQ970A
