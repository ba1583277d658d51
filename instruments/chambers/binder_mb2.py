"""A Binder chamber (MK, MKF, MKFT) with an MB2 controller over Modbus RTU, as `profiles/binder_mb2.toml` says.

Not tried on hardware. Registers: P. Tobiska, control of Binder climate chambers, version 20200630 (MKFT 115). The set
point of manual mode can be given at any time; that the controller obeys it is confirmed once it conditions. Power and
alarms have no registers there, so power reads NaN and the chamber must tell its alarms in another way.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber


class BinderMb2(ProfiledChamber):
    """A chamber behind a Binder MB2. Not tried on hardware; parameters as for `ProfiledChamber`."""

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("binder_mb2"), **options)


Driver = BinderMb2
