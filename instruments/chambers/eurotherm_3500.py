"""A chamber with a Eurotherm 3504 or 3508 controller over Modbus RTU, as `profiles/eurotherm_3500.toml` says.

Not tried on hardware. Addresses: lapkindm/eurotherm2000 (3508) and DiamondLightSource/eurothermModbus (3504). Numbers
are whole, with as many decimals as the controller is set to; where that is not one, `changes = {"decimals": 2}`. No
source tells how its programmer says that it runs: see to it that no program does.
"""

from __future__ import annotations

from typing import Any

from instruments.chambers.profile_file import shipped_profile
from instruments.chambers.profiled import ProfiledChamber


class Eurotherm3500(ProfiledChamber):
    """A chamber behind a Eurotherm 3500. Not tried on hardware; 8N1, parameters as for `ProfiledChamber`."""

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("eurotherm_3500"), **options)


Driver = Eurotherm3500
