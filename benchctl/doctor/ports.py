"""List the serial ports; check permission, use by other processes, latency and stable name of those of a bench."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil
from serial.tools.list_ports import comports

from benchctl.doctor.finding import Finding, bad, look, ok
from benchctl_instruments.links.address import Address

PORTS = "ports"
BY_ID = Path("/dev/serial/by-id")
USUAL_BAUDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 1000000, 1843200, 2000000)

_BRLTTY_UNITS = ("usr/lib/systemd/system", "lib/systemd/system")
_CHANGING_NAMES = ("/dev/ttyUSB", "/dev/ttyACM")
_QUICK_MS = 1
_ROOT_GROUP = 0
_LONGEST_COMMAND = 80
_PTY_MAJORS = range(136, 144)  # devpts: the slaves of pseudo-terminals


def port_findings(*, serial_wanted: bool) -> Iterator[Finding]:
    """List the ports; if there is a USB adapter or the bench uses a serial port, check services that open adapters."""
    ports = sorted(comports(), key=lambda port: port.device)
    if not ports:
        yield ok(PORTS, "serial ports", "none is present")
    for port in ports:
        yield ok(PORTS, port.device, described(port))
    if sys.platform == "linux" and (serial_wanted or any(port.vid is not None for port in ports)):
        yield from seizing_findings()


def described(port: object) -> str:
    """Describe a port, given as pyserial's `ListPortInfo`, with its permanent name."""
    vid, pid = getattr(port, "vid", None), getattr(port, "pid", None)
    usb = f"USB {vid:04X}:{pid:04X}" if vid is not None and pid is not None else ""
    number = getattr(port, "serial_number", None)
    product, description = getattr(port, "product", None), getattr(port, "description", None)
    words = [usb, getattr(port, "manufacturer", None), product or (description if description != "n/a" else None)]
    text = " ".join(word for word in words if word) or "no USB adapter, or one without a description"
    lasting = lasting_name(getattr(port, "device", ""))
    return text + (f", serial number {number}" if number else "") + (f", also {lasting}" if lasting else "")


def lasting_name(device: str, folder: Path = BY_ID) -> Path | None:
    """Return the name of a device under `/dev/serial/by-id`, which is the same after each start."""
    try:
        names = sorted(folder.iterdir())
    except OSError:
        return None
    place = Path(device).resolve()
    return next((name for name in names if name.resolve() == place), None)


def seizing_findings(root: Path = Path("/")) -> Iterator[Finding]:
    """Warn of ModemManager and brltty, which open adapters that they take for modems or Braille displays."""
    manager, braille = _running("ModemManager"), _running("brltty")
    if manager is not None:
        yield look(
            PORTS,
            "ModemManager",
            f"{_described_process(manager)} runs: it opens each new adapter to find out whether it is a modem",
            'sudo systemctl disable --now ModemManager, or a udev rule with ENV{ID_MM_DEVICE_IGNORE}="1"',
        )
    if braille is not None or any((root / folder / "brltty-udev.service").exists() for folder in _BRLTTY_UNITS):
        yield look(
            PORTS,
            "brltty",
            f"{'runs' if braille else 'is installed'}: it takes adapters with a CH340 or CP210x for Braille displays, "
            "and their port disappears",
            "sudo systemctl mask --now brltty-udev.service brltty.path, unless a Braille display is used here",
        )
    if manager is None and braille is None:
        yield ok(PORTS, "services", "neither ModemManager nor brltty runs, which would open adapters")


def findings_of_port(role: str, address: Address) -> Iterator[Finding]:
    """Check the port of an instrument; nothing is sent. The last finding is bad if it cannot be opened."""
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
        yield bad(role, "port", f"{device} is not a port but a {_kind(mode)}", f"name a port: {_others()}")
        return
    yield from _name(role, device)
    if latency := latency_finding(role, device):
        yield latency
    refused = permission_finding(role, device)
    if refused is not None:
        yield refused
        return
    yield _free(role, device)


def latency_finding(role: str, device: str, root: Path = Path("/")) -> Finding | None:
    """Check how long an FTDI adapter delays a short answer; return None for other adapters."""
    name = Path(device).resolve().name
    timer = root / "sys/class/tty" / name / "device/latency_timer"
    try:
        milliseconds = int(timer.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
    message = f"FTDI latency timer of {name}: {milliseconds} ms"
    if milliseconds <= _QUICK_MS:
        return ok(role, "latency", message)
    return look(
        role,
        "latency",
        f"{message}: the adapter delays each short answer by that time",
        f"echo {_QUICK_MS} | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer; permanently, a udev rule: "
        f'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{{latency_timer}}="{_QUICK_MS}"',
    )


def _speed(role: str, address: Address) -> Iterator[Finding]:
    if address.baud is None:
        yield look(
            role,
            "speed",
            f"{address} states no baud rate; the driver uses its own default",
            f"add the baud rate that is set at the instrument: {address}?baud=19200",
        )
    elif address.baud not in USUAL_BAUDS:
        nearest = min(USUAL_BAUDS, key=lambda baud: abs(baud - (address.baud or 0)))
        yield look(role, "speed", f"{address.baud} baud is not a usual speed", f"was {nearest} meant?")
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
            f"{device} may belong to another adapter after the next start, and it has no name in /dev/serial/by-id",
            "a udev rule with a SYMLINK for it, by its serial number or its USB socket",
        )
    else:
        do = f'address = "serial://{lasting}?baud=…" always names this adapter'
        yield look(role, "name", f"{device} may belong to another adapter after the next start", do)


def _free(role: str, device: str) -> Finding:
    found, closed = holders(device)
    if found:
        who = ", ".join(map(_described_process, found))
        return bad(role, "port", f"{device} is in use by {who}", f"end it: kill {found[0].pid}, or wait until it ends")
    unseen = f"; {closed} processes of other users could not be inspected" if closed else ""
    return ok(role, "port", f"{device}: exists, is readable and writable, and no other process has it open{unseen}")


def _of_windows(role: str, address: Address) -> Finding:
    names = {port.device.upper(): port for port in comports()}
    port = names.get(address.device.upper())
    if port is None:
        return bad(role, "port", f"there is no {address.device}; {_others()}", _plug_in(address.device))
    do = "FTDI adapters: Device Manager > Ports > Port Settings > Advanced: latency timer 1 ms"
    return ok(role, "port", f"{port.device}: {described(port)}", do)


def _absence(err: OSError) -> str:
    return "no such port" if isinstance(err, FileNotFoundError) else (err.strerror or str(err))


def _others() -> str:
    ports = sorted(port.device for port in comports())
    return f"there are {', '.join(ports)}" if ports else "this machine has no serial port"


def _plug_in(device: str) -> str:
    return f"plug the adapter in and switch it on (sudo dmesg lists it), or correct {device} in the bench"


def _kind(mode: int) -> str:
    kinds = ((stat.S_ISDIR, "folder"), (stat.S_ISREG, "file"), (stat.S_ISSOCK, "socket"), (stat.S_ISFIFO, "pipe"))
    return next((word for is_kind, word in kinds if is_kind(mode)), "device of another kind")


@dataclass(frozen=True, slots=True, kw_only=True)
class Owner:
    """The group of a device by number and name, and whether that group may read and write it."""

    gid: int
    group: str
    group_may: bool


def permission_finding(role: str, device: str) -> Finding | None:
    """Return the finding if this user has no permission to use a port, otherwise None."""
    if os.access(device, os.R_OK | os.W_OK):
        return None
    import grp

    status, user = os.stat(device), psutil.Process().username()
    try:
        group = grp.getgrgid(status.st_gid)
        name, entered = group.gr_name, user in group.gr_mem
    except KeyError:
        name, entered = str(status.st_gid), False
    may = bool(status.st_mode & stat.S_IRGRP and status.st_mode & stat.S_IWGRP)
    owner = Owner(gid=status.st_gid, group=name, group_may=may)
    return refused_finding(role, device, owner, user, os.getgroups(), entered=entered)


def refused_finding(
    role: str, device: str, owner: Owner, user: str, groups: Sequence[int], *, entered: bool
) -> Finding:
    """Return the finding on a port that a user may not use, with the command that grants permission.

    `groups` are those of the session; `entered` is true if the system's files list the user in the port's group.
    """
    message = f"{user} may not read and write {device}, which belongs to group {owner.group}"
    if not owner.group_may or owner.gid == _ROOT_GROUP:
        do = (
            f'a udev rule, SUBSYSTEM=="tty", KERNEL=="{os.path.basename(device)}", GROUP="dialout", MODE="0660", and: '
            f"sudo usermod -a -G dialout {user}, then log in again"
        )
        return bad(role, "permission", f"{message}, a group that is not for users", do)
    if entered and owner.gid not in groups:
        do = f"log out and in again (in this terminal only: newgrp {owner.group})"
        return bad(role, "permission", f"{message}; {user} is in that group, but this session began before", do)
    do = f"sudo usermod -a -G {owner.group} {user}, then log out and in again"
    return bad(role, "permission", message, do)


def holders(device: str) -> tuple[list[psutil.Process], int]:
    """Return the other processes that have a device open, and the number of processes that could not be inspected.

    The process at the other end of a pseudo-terminal does not count. (psutil lists open regular files only.)
    """
    try:
        wanted = os.stat(device).st_rdev
    except OSError:
        return [], 0
    found, closed = [], 0
    for pid in psutil.pids():
        if pid == os.getpid():
            continue
        try:
            opened = list(_devices(Path(f"/proc/{pid}/fd")))
            if wanted in opened and not (os.major(wanted) in _PTY_MAJORS and os.makedev(5, 2) in opened):
                found.append(psutil.Process(pid))
        except PermissionError:
            closed += 1
        except (OSError, psutil.Error):  # the process has ended
            continue
    return found, closed


def _devices(folder: Path) -> Iterator[int]:
    """Yield the devices behind the open files of a process."""
    for link in folder.iterdir():
        try:
            status = link.stat()
        except OSError:  # closed meanwhile, or in another namespace
            continue
        if stat.S_ISCHR(status.st_mode):
            yield status.st_rdev


def _described_process(process: psutil.Process) -> str:
    try:
        words = " ".join(process.cmdline()) or process.name()
    except psutil.Error:
        words = ""
    shown = "".join(letter if letter.isprintable() else "?" for letter in words)
    shown = shown if len(shown) <= _LONGEST_COMMAND else f"{shown[: _LONGEST_COMMAND - 3]}..."
    return f"process {process.pid} ({shown})"


def _running(name: str) -> psutil.Process | None:
    return next((each for each in psutil.process_iter(["name"]) if each.info["name"] == name), None)
