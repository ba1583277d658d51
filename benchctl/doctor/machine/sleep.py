"""What may send this machine to sleep, or restart it, in the middle of a weekend's campaign."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchctl.doctor.asked import answer, properties
from benchctl.doctor.finding import MACHINE, Finding, look, ok

_TARGETS = ("sleep.target", "suspend.target", "hibernate.target", "hybrid-sleep.target")
_MASK = f"sudo systemctl mask {' '.join(_TARGETS)} (unmask afterwards)"
_INHIBIT = "or begin the run with: systemd-inhibit --what=sleep:idle:handle-lid-switch:shutdown benchctl run …"
_UPDATE_TIMERS = (
    "apt-daily-upgrade.timer",
    "dnf-automatic.timer",
    "dnf-automatic-install.timer",
    "dnf5-automatic.timer",
)
_LAPTOPS = frozenset({"8", "9", "10", "14", "31", "32"})  # SMBIOS 3.7, table 17: portable … detachable
_DESKTOP = "org.gnome.settings-daemon.plugins.power"


def sleep_findings(root: Path = Path("/")) -> Iterator[Finding]:
    """Sleep, the lid, the battery, updates; `root` is where `etc`, `proc` and `sys` lie."""
    if sys.platform == "win32":
        from benchctl.doctor.machine.windows import power_findings

        yield from power_findings()
        return
    if sys.platform != "linux":
        do = "switch off sleep in the system's settings (on a Mac: caffeinate -is benchctl run …)"
        yield look(MACHINE, "sleep", "is not looked at on this system", do)
        return
    if (root / "run/systemd/system").is_dir():
        enabled = answer("systemctl", "is-enabled", *_TARGETS)
        yield sleep_finding(enabled, login_settings(root, answer("loginctl", "show-session")), is_laptop(root))
        yield from desktop_findings(answer("gsettings", "get", _DESKTOP, "sleep-inactive-ac-type"))
    else:
        yield ok(MACHINE, "sleep", "no systemd runs here (a container, or another init), which could send it to sleep")
    yield from _battery(root)
    yield update_finding(
        answer("systemctl", "is-active", *_UPDATE_TIMERS),
        answer("apt-config", "dump", "APT::Periodic::Unattended-Upgrade"),
        answer("apt-config", "dump", "Unattended-Upgrade::Automatic-Reboot"),
    )


def sleep_finding(enabled: str | None, login: dict[str, str], laptop: bool) -> Finding:
    """Whether systemd may suspend: by `systemctl is-enabled` of the targets, a word each, and logind's settings."""
    words = (enabled or "").split()
    if words and all(word.startswith("masked") for word in words):
        return ok(MACHINE, "sleep", "suspend and hibernation are masked")
    reasons = []
    if (idle := login.get("IdleAction", "ignore")) not in ("ignore", ""):
        reasons.append(f"logind does {idle} when nobody types (IdleAction)")
    if laptop and (lid := login.get("HandleLidSwitch", "suspend")) not in ("ignore", ""):
        reasons.append(f"closing the lid does {lid} (HandleLidSwitch)")
    if reasons:
        return look(MACHINE, "sleep", "; ".join(reasons), f"{_MASK}, {_INHIBIT}")
    return ok(MACHINE, "sleep", "logind does nothing when nobody types; suspend is not masked: a menu can still do it")


def login_settings(root: Path, told: str | None) -> dict[str, str]:
    """Settings of logind, as it says itself or, where it does not run, from its files; later ones win."""
    if found := properties(told):
        return found
    files = [root / "etc/systemd/logind.conf", *sorted((root / "etc/systemd/logind.conf.d").glob("*.conf"))]
    for file in files:
        if file.is_file():
            lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
            found |= properties("\n".join(line for line in lines if not line.lstrip().startswith(("#", ";"))))
    return found


def desktop_findings(told: str | None) -> Iterator[Finding]:
    """Whether GNOME suspends when nobody types, which it does however logind is set, on the mains too."""
    if told is None:
        return
    if (action := told.strip("'\" \n")) in ("nothing", "blank", ""):
        yield ok(MACHINE, "desktop", "GNOME does not suspend when nobody types")
        return
    do = f"gsettings set {_DESKTOP} sleep-inactive-ac-type nothing (in the session that is logged in at the screen)"
    yield look(MACHINE, "desktop", f"GNOME does {action} when nobody types, on the mains too", do)


def update_finding(timers: str | None, periodic: str | None, reboot: str | None) -> Finding:
    """Whether updates come by themselves, by `systemctl is-active` of their timers and by apt's configuration."""
    running = [name for name, word in zip(_UPDATE_TIMERS, (timers or "").split(), strict=False) if word == "active"]
    upgrades = '"1"' in (periodic or "") or any(not name.startswith("apt") for name in running)
    restarts = '"true"' in (reboot or "").lower()
    stop = f"sudo systemctl stop {' '.join(running) or 'unattended-upgrades'} for as long as the campaign lasts"
    if restarts:
        return look(MACHINE, "updates", "come by themselves, and restart this machine (Automatic-Reboot)", stop)
    if upgrades:
        return look(MACHINE, "updates", "come by themselves, and restart services as they do", stop)
    return ok(MACHINE, "updates", "none come by themselves, as far as apt and systemd tell")


def is_laptop(root: Path) -> bool:
    """Whether it has a lid."""
    if any((root / "proc/acpi/button/lid").glob("*")):
        return True
    try:
        return (root / "sys/class/dmi/id/chassis_type").read_text(encoding="ascii").strip() in _LAPTOPS
    except (OSError, UnicodeDecodeError):
        return False


def _battery(root: Path) -> Iterator[Finding]:
    for status in sorted((root / "sys/class/power_supply").glob("BAT*/status")):
        if status.read_text(encoding="ascii", errors="replace").strip() == "Discharging":
            do = "plug in the mains adapter"
            yield look(MACHINE, "battery", f"{status.parent.name} is being discharged: no mains", do)
        else:
            yield ok(MACHINE, "battery", f"{status.parent.name} is not being discharged")
