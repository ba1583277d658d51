"""Keysight DAQ970A with a DAQM901A multiplexer, by SCPI over TCP. Not tried on hardware.

It keeps the commands of the 34970A, as public clients show: the DAQ970A wrappers of laboratories configure, scan and
time it as `keysight_34970a` does.
"""

from __future__ import annotations

from benchctl_instruments.digitizers.keysight_34970a import Keysight34970A
from benchctl_instruments.digitizers.scanning_meter import recognition_of


class KeysightDAQ970A(Keysight34970A):
    """A DAQ970A; see `ScanningMeter`."""

    NAME, MODEL = "Keysight DAQ970A", "DAQ970A"
    recognition = recognition_of(MODEL, "STAT:OPER:COND?")


Driver = KeysightDAQ970A
