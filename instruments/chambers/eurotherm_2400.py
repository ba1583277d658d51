"""A chamber with a Eurotherm 2400 series controller over Modbus RTU, as `profiles/eurotherm_2400.toml` says.

Not tried on hardware. Addresses and singles: hailegroup/nupylab (eurotherm2400). Register 75, and manual mode without
output as "off": HACS (EurothermFurnace). Register 258: AERCO SmartPlate manual OMM-0069, page 101. A set point is
written only where it changes, since it lies in an EEPROM; for the same reason a long ramp in many small steps wears it.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber


class Eurotherm2400(ProfiledChamber):
    """A chamber behind a Eurotherm 2400. Not tried on hardware; 8N1, parameters as for `ProfiledChamber`."""

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("eurotherm_2400"), **options)


Driver = Eurotherm2400
