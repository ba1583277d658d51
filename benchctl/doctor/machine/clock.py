"""The clock that stamps recordings: its year, and whether anything keeps it right."""

from __future__ import annotations

import ctypes
import re
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import benchctl
from benchctl.doctor.asked import answer, properties
from benchctl.doctor.finding import MACHINE, Finding, bad, look, ok

_LAST_YEAR = 2100
_ZONES = timedelta(days=1)  # files that came from a clock set to another zone
_TIME_ERROR = 5  # what adjtimex(2) returns while nobody vouches for the clock
_TIMEX_BYTES = 512  # more than struct timex takes anywhere

_SYNCHRONISE = "sudo timedatectl set-ntp true, or install chrony; without a network set it by hand before each campaign"


def clock_findings() -> Iterator[Finding]:
    """Its year, and its synchronisation."""
    newest = datetime.fromtimestamp(Path(benchctl.__file__).stat().st_mtime, UTC)
    yield year_finding(datetime.now(UTC), newest)
    if sys.platform == "win32":
        from benchctl.doctor.machine.windows import clock_finding

        yield clock_finding(answer("w32tm", "/query", "/status"))
    else:
        yield synchronised_finding(
            answer("timedatectl", "show"), answer("chronyc", "-n", "tracking"), _kernel_vouches()
        )


def year_finding(now: datetime, newest: datetime) -> Finding:
    """Whether the time can be true; `newest` is that of a file which is there already, benchctl's own."""
    says = f"{now:%Y-%m-%d %H:%M:%S} UTC"
    do = "set it: sudo timedatectl set-time 'YYYY-MM-DD HH:MM:SS'; recordings and certificates go by it"
    if now.year >= _LAST_YEAR:
        return bad(MACHINE, "clock", f"{says} cannot be true", do, unusable=True)
    if now < newest - _ZONES:
        return bad(
            MACHINE,
            "clock",
            f"{says} is before {newest:%Y-%m-%d %H:%M}, when benchctl was installed",
            do,
            unusable=True,
        )
    return ok(MACHINE, "clock", says)


def synchronised_finding(timedatectl: str | None, chronyc: str | None, kernel_vouches: bool | None) -> Finding:
    """Whether it is kept right, by what these programs print, and by what the kernel says (None: it does not)."""
    if chronyc and (status := re.search(r"^Leap status\s*:\s*(.*)$", chronyc, re.MULTILINE)):
        off = re.search(r"^System time\s*:\s*(.*?) of NTP time", chronyc, re.MULTILINE)
        says = f"chrony: {status[1].strip().lower()}{f', {off[1]}' if off else ''}"
        if "not sync" not in status[1].lower():
            return ok(MACHINE, "synchronised", says)
        do = "chronyc sources shows whom it asks; let UDP port 123 through, or name a server in chrony.conf"
        return look(MACHINE, "synchronised", says, do)
    told = properties(timedatectl)
    if "NTPSynchronized" in told:
        service = {"yes": "its service is on", "no": "no service keeps it"}.get(told.get("NTP", ""), "no word of NTP")
        if told["NTPSynchronized"] == "yes":
            return ok(MACHINE, "synchronised", f"by NTP, as timedatectl says; {service}")
        return look(MACHINE, "synchronised", f"not synchronised, as timedatectl says; {service}", _SYNCHRONISE)
    if kernel_vouches is None:
        return look(MACHINE, "synchronised", "cannot be told: neither timedatectl nor chronyc answers", _SYNCHRONISE)
    if kernel_vouches:
        return ok(
            MACHINE, "synchronised", "as the kernel says; timedatectl and chronyc, which tell by whom, do not answer"
        )
    return look(MACHINE, "synchronised", "not synchronised, as the kernel says", _SYNCHRONISE)


def _kernel_vouches() -> bool | None:
    if sys.platform != "linux":
        return None
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != _TIME_ERROR
