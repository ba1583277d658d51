"""A Binder chamber (MK, MKF, MKFT) with an MB2 controller over Modbus RTU, as `profiles/binder_mb2.toml` declares.

Not tried on hardware. Registers: P. Tobiska, control of Binder climate chambers, version 20200630 (MKFT 115). The set
point of manual mode can be written at any time; that the controller follows it is confirmed while it is conditioning.
There are no registers for power and alarms, so power reads NaN and alarms must be reported by other means.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber, recognition_of


class BinderMb2(ProfiledChamber):
    """Driver of a chamber with a Binder MB2. Not tried on hardware; parameters as for `ProfiledChamber`."""

    recognition = recognition_of(shipped_profile("binder_mb2"))

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("binder_mb2"), **options)


Driver = BinderMb2
