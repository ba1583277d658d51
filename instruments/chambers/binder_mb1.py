"""A Binder chamber (MK 53, MK, MKF, MKFT) with an MB1 over Modbus RTU, as `profiles/binder_mb1.toml` declares.

Not tried on hardware; its numbers are held against the dump of an MK 53's memory in ecree-solarflare/ovenctl. The set
points of manual and of basic mode are both written, since the sources contradict each other about which is which; that
the controller follows is confirmed while it conditions. There is no register for power, which reads NaN.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber, recognition_of


class BinderMb1(ProfiledChamber):
    """Driver of a chamber with a Binder MB1. Not tried on hardware; parameters as for `ProfiledChamber`."""

    recognition = recognition_of(shipped_profile("binder_mb1"))

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("binder_mb1"), **options)


Driver = BinderMb1
