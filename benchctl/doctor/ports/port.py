"""A serial port that a bench names: there, permitted, free, quick, and by a name that stays."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

from serial.tools.list_ports import comports

from benchctl.doctor.finding import Finding, bad, look, ok
from benchctl.doctor.ports.listed import described, lasting_name
from benchctl.doctor.ports.permission import permission_finding
from benchctl.doctor.ports.processes import holders
from benchctl_instruments.links.address import Address

USUAL_BAUDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 1000000, 1843200, 2000000)
_CHANGING_NAMES = ("/dev/ttyUSB", "/dev/ttyACM")
_QUICK_MS = 1


def findings_of_port(role: str, address: Address) -> Iterator[Finding]:
    """All about the port of an instrument; nothing is sent. The last finding is bad where it cannot be opened."""
    yield from _speed(role, address)
    if sys.platform == "win32":
        yield _of_windows(role, address)
        return
    device = address.device
    try:
        mode = os.stat(device).st_mode
    except OSError as err:
        yield bad(role, "port", f"{device}: {_absence(err)}; {_others()}", _plug_in(device))
        return
    if not stat.S_ISCHR(mode):
        yield bad(role, "port", f"{device} is no port but a {_kind(mode)}", f"name a port: {_others()}")
        return
    yield from _name(role, device)
    yield from _latency(role, device)
    refused = permission_finding(role, device)
    if refused is not None:
        yield refused
        return
    yield _free(role, device)


def latency_finding(role: str, device: str, root: Path = Path("/")) -> Finding | None:
    """How long an FTDI adapter keeps a short answer back; None where the adapter is another."""
    name = Path(device).resolve().name
    timer = root / "sys/class/tty" / name / "device/latency_timer"
    try:
        milliseconds = int(timer.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
    says = f"FTDI latency timer of {name}: {milliseconds} ms"
    if milliseconds <= _QUICK_MS:
        return ok(role, "latency", says)
    return look(
        role,
        "latency",
        f"{says}: each short answer waits so long in the adapter",
        f"echo {_QUICK_MS} | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer; for good, a udev rule: "
        f'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{{latency_timer}}="{_QUICK_MS}"',
    )


def _speed(role: str, address: Address) -> Iterator[Finding]:
    if address.baud is None:
        yield look(
            role,
            "speed",
            f"{address} does not say how fast; the driver takes its own default",
            f"write it down as the instrument is set: {address}?baud=19200",
        )
    elif address.baud not in USUAL_BAUDS:
        nearest = min(USUAL_BAUDS, key=lambda baud: abs(baud - (address.baud or 0)))
        yield look(role, "speed", f"{address.baud} baud is no usual speed", f"was {nearest} meant?")
    else:
        yield ok(role, "speed", f"{address.baud} baud, 8N1")


def _name(role: str, device: str) -> Iterator[Finding]:
    if not device.startswith(_CHANGING_NAMES):
        return
    lasting = lasting_name(device)
    if lasting is None:
        yield look(
            role,
            "name",
            f"{device} may be another adapter's after the next start, and this one has no name in /dev/serial/by-id",
            "a udev rule with a SYMLINK for it, by its serial number or its USB socket",
        )
    else:
        do = f'address = "serial://{lasting}?baud=…" stays with the adapter'
        yield look(role, "name", f"{device} may be another adapter's after the next start", do)


def _latency(role: str, device: str) -> Iterator[Finding]:
    if finding := latency_finding(role, device):
        yield finding


def _free(role: str, device: str) -> Finding:
    found, closed = holders(device)
    if found:
        who = ", ".join(map(str, found))
        return bad(
            role, "port", f"{device} is in use by {who}", f"end it: kill {found[0].pid}, or wait until it is done"
        )
    unseen = f"; {closed} processes of others could not be looked into" if closed else ""
    return ok(role, "port", f"{device}: there, may be read and written, and nobody has it open{unseen}")


def _of_windows(role: str, address: Address) -> Finding:
    names = {port.device.upper(): port for port in comports()}
    port = names.get(address.device.upper())
    if port is None:
        return bad(role, "port", f"there is no {address.device}; {_others()}", _plug_in(address.device))
    do = "FTDI adapters: Device Manager > Ports > Port Settings > Advanced: latency timer 1 ms"
    return ok(role, "port", f"{port.device}: {described(port)}", do)


def _absence(err: OSError) -> str:
    return "there is no such port" if isinstance(err, FileNotFoundError) else (err.strerror or str(err))


def _others() -> str:
    ports = sorted(port.device for port in comports())
    return f"there are {', '.join(ports)}" if ports else "no serial port is plugged in"


def _plug_in(device: str) -> str:
    return (
        f"plug the adapter in and switch it on (sudo dmesg tells what the system saw), or correct {device} in the bench"
    )


def _kind(mode: int) -> str:
    kinds = ((stat.S_ISDIR, "folder"), (stat.S_ISREG, "file"), (stat.S_ISSOCK, "socket"), (stat.S_ISFIFO, "pipe"))
    return next((word for is_kind, word in kinds if is_kind(mode)), "device of another kind")
