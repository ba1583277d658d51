"""A chamber with a Eurotherm 3504 or 3508 controller over Modbus RTU, as `profiles/eurotherm_3500.toml` says.

Not tried on hardware. Addresses: MinimalModbus 0.5 (eurotherm3500.py), and for the output of manual mode
lapkindm/eurotherm2000 (3508). Numbers are whole, with as many decimals as the controller is set to; where that is not
one, `changes = {"decimals": 2}`. No source names a register that shows whether a program runs: make sure that none
does.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber


class Eurotherm3500(ProfiledChamber):
    """A chamber behind a Eurotherm 3500. Not tried on hardware; 8N1, parameters as for `ProfiledChamber`."""

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("eurotherm_3500"), **options)


Driver = Eurotherm3500
