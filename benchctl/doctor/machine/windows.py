"""Windows: sleep, power, clock, firewall, by what its own programs print. Written from their documents, not tried.

Their words come in the system's language; what is read is what does not change with it: numbers, and names of settings.
"""

from __future__ import annotations

import ctypes
import re
import sys
from collections.abc import Iterator

from benchctl.doctor.asked import answer
from benchctl.doctor.finding import MACHINE, Finding, look, ok

_NOT_TRIED = "(not tried on Windows by those who wrote this)"
_HEX = re.compile(r":\s*0x([0-9a-fA-F]{8})\s*$", re.MULTILINE)
_SETTINGS = {"sleep": "STANDBYIDLE", "hibernation": "HIBERNATEIDLE"}
_COMMANDS = {"sleep": "standby-timeout", "hibernation": "hibernate-timeout"}
_ON_BATTERY = 0


def power_findings() -> Iterator[Finding]:
    """Sleep and hibernation after a time without keys, the mains, updates."""
    for what, setting in _SETTINGS.items():
        yield idle_finding(what, answer("powercfg", "/query", "SCHEME_CURRENT", "SUB_SLEEP", setting))
    if sys.platform == "win32":
        status = (ctypes.c_byte * 12)()  # SYSTEM_POWER_STATUS; its first byte is ACLineStatus
        if ctypes.windll.kernel32.GetSystemPowerStatus(ctypes.byref(status)) and status[0] == _ON_BATTERY:
            yield look(MACHINE, "battery", f"it runs on its battery {_NOT_TRIED}", "plug in the mains adapter")
    yield look(
        MACHINE,
        "updates",
        f"Windows Update restarts by itself outside the active hours; that cannot be asked for here {_NOT_TRIED}",
        "Settings > Windows Update > Pause updates, for as long as the campaign lasts",
    )


def idle_finding(what: str, told: str | None) -> Finding:
    """Whether Windows does it by itself, by `powercfg /query`.

    Its last two numbers are seconds on the mains and on battery; 0 is never.
    """
    found = _HEX.findall(told or "")
    on_mains, on_battery = f"powercfg /change {_COMMANDS[what]}-ac 0", f"powercfg /change {_COMMANDS[what]}-dc 0"
    if len(found) < 2:
        says = f"cannot be told: powercfg does not say {_NOT_TRIED}"
        return look(MACHINE, what, says, f"{on_mains} and {on_battery}")
    mains_s, battery_s = int(found[-2], 16), int(found[-1], 16)
    says = f"on the mains {_after(mains_s)}, on battery {_after(battery_s)} {_NOT_TRIED}"
    return look(MACHINE, what, says, on_mains) if mains_s else ok(MACHINE, what, says)


def clock_finding(told: str | None) -> Finding:
    """Whether the clock is kept right, by `w32tm /query /status`: stratum 0, or no answer, is not synchronised."""
    stratum = re.search(r"(?:Stratum|Schicht|Страта)\s*:\s*(\d+)", told or "")
    if stratum and int(stratum[1]):
        return ok(MACHINE, "synchronised", f"by the Windows Time service, stratum {stratum[1]} {_NOT_TRIED}")
    do = "as administrator: net start w32time, then w32tm /resync"
    return look(MACHINE, "synchronised", f"the Windows Time service does not say so {_NOT_TRIED}", do)


def _after(seconds: int) -> str:
    return f"after {seconds / 60:g} min without keys" if seconds else "never"
