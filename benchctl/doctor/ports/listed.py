"""Every serial port of this machine, and the services that take hold of adapters by themselves."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from serial.tools.list_ports import comports

from benchctl.doctor.finding import Finding, look, ok
from benchctl.doctor.ports.processes import running

PORTS = "ports"
BY_ID = Path("/dev/serial/by-id")

_BRLTTY_UNITS = ("usr/lib/systemd/system", "lib/systemd/system")


def port_findings(*, serial_wanted: bool) -> Iterator[Finding]:
    """The ports, one by one; and the services where there is a port for them, or the bench wants one."""
    ports = sorted(comports(), key=lambda port: port.device)
    if not ports:
        yield ok(PORTS, "serial ports", "none is plugged in")
    for port in ports:
        yield ok(PORTS, port.device, described(port))
    if sys.platform == "linux" and (serial_wanted or any(port.vid is not None for port in ports)):
        yield from seizing_findings()


def described(port: object) -> str:
    """What pyserial's `ListPortInfo` says of a port, and its name that stays."""
    vid, pid = getattr(port, "vid", None), getattr(port, "pid", None)
    usb = f"USB {vid:04X}:{pid:04X}" if vid is not None and pid is not None else ""
    number = getattr(port, "serial_number", None)
    product, description = getattr(port, "product", None), getattr(port, "description", None)
    words = [usb, getattr(port, "manufacturer", None), product or (description if description != "n/a" else None)]
    said = " ".join(word for word in words if word) or "no USB adapter, or it says nothing"
    lasting = lasting_name(getattr(port, "device", ""))
    return said + (f", serial number {number}" if number else "") + (f", also {lasting}" if lasting else "")


def lasting_name(device: str, folder: Path = BY_ID) -> Path | None:
    """The name under `/dev/serial/by-id` of a device, which stays where it is plugged in anew, or others are."""
    try:
        names = sorted(folder.iterdir())
    except OSError:
        return None
    place = Path(device).resolve()
    return next((name for name in names if name.resolve() == place), None)


def seizing_findings(root: Path = Path("/")) -> Iterator[Finding]:
    """ModemManager and brltty: they open, or take, adapters that they believe to be modems or Braille displays."""
    manager = running("ModemManager", root / "proc")
    if manager is not None:
        yield look(
            PORTS,
            "ModemManager",
            f"{manager} runs: it opens each adapter that is plugged in and asks it whether it is a modem",
            'sudo systemctl disable --now ModemManager, or a udev rule with ENV{ID_MM_DEVICE_IGNORE}="1"',
        )
    braille = running("brltty", root / "proc")
    if braille is not None or any((root / folder / "brltty-udev.service").exists() for folder in _BRLTTY_UNITS):
        yield look(
            PORTS,
            "brltty",
            f"{'runs' if braille else 'is installed'}: it takes adapters with a CH340 or CP210x for Braille displays, "
            "and their port vanishes",
            "sudo systemctl mask --now brltty-udev.service brltty.path, unless a Braille display is used here",
        )
    if manager is None and braille is None:
        yield ok(PORTS, "services", "neither ModemManager nor brltty runs, which take hold of adapters")
