"""A chamber with a Eurotherm 2400 series controller over Modbus RTU, as `profiles/eurotherm_2400.toml` declares.

Not tried on hardware. Addresses and singles: hailegroup/nupylab (eurotherm2400). Register 75, and manual mode without
output as "off": HACS (EurothermFurnace). Register 258: AERCO SmartPlate manual OMM-0069, page 101. A set point is
written only if it changes, since it is stored in an EEPROM; a long ramp in many small steps therefore wears it out.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber, recognition_of


class Eurotherm2400(ProfiledChamber):
    """Driver of a chamber with a Eurotherm 2400. Not tried on hardware; 8N1, parameters as for `ProfiledChamber`."""

    recognition = recognition_of(shipped_profile("eurotherm_2400"))

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("eurotherm_2400"), **options)


Driver = Eurotherm2400
