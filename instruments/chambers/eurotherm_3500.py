"""A chamber with a Eurotherm 3504 or 3508 controller over Modbus RTU, as `profiles/eurotherm_3500.toml` declares.

Not tried on hardware. Addresses: MinimalModbus 0.5 (eurotherm3500.py), and for the output of manual mode
lapkindm/eurotherm2000 (3508). Numbers are integers with the number of decimals set on the controller; if that is not
one, use `changes = {"decimals": 2}`. No source names a register that shows whether a program is running: make sure that
none is.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber, recognition_of


class Eurotherm3500(ProfiledChamber):
    """Driver of a chamber with a Eurotherm 3500. Not tried on hardware; 8N1, parameters as for `ProfiledChamber`."""

    recognition = recognition_of(shipped_profile("eurotherm_3500"))

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("eurotherm_3500"), **options)


Driver = Eurotherm3500
