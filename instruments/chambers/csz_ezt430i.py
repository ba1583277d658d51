"""A chamber with a CSZ EZT-430i controller over Modbus RTU, as `profiles/csz_ezt430i.toml` declares.

Not tried on hardware. Registers: EZT-430i Communications Manual, revision C, pages 4.8 to 5.7. Codes of register 39,
bit of register 12 and the pause of 0.5 s: O. Hartbrich, csz_ezt430i. For a chamber with another bit or decimal point:
`changes = {"switch": {"bit": 1}, "decimals": 2}`. No register shows whether the unit is degrees Celsius.
"""

from __future__ import annotations

from typing import Any

from benchctl_instruments.chambers.profile import shipped_profile
from benchctl_instruments.chambers.profiled import ProfiledChamber, recognition_of


class CszEzt430i(ProfiledChamber):
    """Driver of a chamber with a CSZ EZT-430i. Not tried on hardware; parameters as for `ProfiledChamber`."""

    recognition = recognition_of(shipped_profile("csz_ezt430i"))

    def __init__(self, address: str, **options: Any) -> None:
        super().__init__(address, profile=shipped_profile("csz_ezt430i"), **options)


Driver = CszEzt430i
