import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from benchctl.doctor.finding import Finding
from benchctl.doctor.ports import (
    Owner,
    described,
    findings_of_port,
    holders,
    lasting_name,
    latency_finding,
    port_findings,
    refused_finding,
    seizing_findings,
)
from benchctl_instruments.links.address import parse_address
from tests.benchctl.doctor.ptys import held, terminal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="ports of POSIX")

needs_proc = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")

DIALOUT = Owner(gid=20, group="dialout", group_may=True)

AS_NOBODY = """
import os, sys
from benchctl.doctor.ports import findings_of_port
from benchctl_instruments.links.address import parse_address
import grp, pwd
address = parse_address(sys.argv[1])
os.setgroups([]); os.setgid(65534); os.setuid(65534)
for each in findings_of_port("chamber", address):
    print(each.verdict, each.what, each.message, each.do, sep="|")
"""


def _of(address: str) -> dict[str, Finding]:
    return {finding.what: finding for finding in findings_of_port("chamber", parse_address(address))}


def test_a_free_port_that_is_permitted_is_fine() -> None:
    with terminal() as device:
        found = _of(f"serial://{device}?baud=9600")
    assert (found["port"].verdict, found["speed"].message) == ("ok", "9600 baud, 8N1")
    assert f"{device}: exists, is readable and writable, and no other process has it open" in found["port"].message


def test_a_port_that_is_not_there_names_those_that_are() -> None:
    finding = _of("serial:///dev/ttyUSB77?baud=9600")["port"]
    assert finding.verdict == "bad"
    assert finding.message.startswith("/dev/ttyUSB77: no such port; ")
    assert finding.do.startswith("plug the adapter in")


def test_what_is_no_port_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "is not a port but a file" in _of(f"serial://{tmp_path}/file?baud=9600")["port"].message
    assert "is not a port but a folder" in _of(f"serial://{tmp_path}?baud=9600")["port"].message


def test_the_process_that_has_a_port_open_is_named() -> None:
    with terminal() as device, held(device) as pid:
        finding = _of(f"serial://{device}?baud=9600")["port"]
    assert finding.verdict == "bad"
    assert f"{device} is in use by process {pid} ({sys.executable} -c import os" in finding.message
    assert finding.do == f"end it: kill {pid}, or wait until it ends"


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 1)() != 0, reason="needs root, to become another user")
def test_a_user_who_may_not_gets_the_very_command_that_lets_him() -> None:
    with terminal() as device:
        os.chown(device, 0, 20)  # dialout in Debian; whatever it is called here
        os.chmod(device, 0o660)
        ran = subprocess.run(
            [sys.executable, "-c", AS_NOBODY, f"serial://{device}?baud=9600"],
            capture_output=True,
            text=True,
            check=True,
        )
    verdict, what, says, do = ran.stdout.splitlines()[-1].split("|")
    assert (verdict, what) == ("bad", "permission")
    assert says.startswith(f"nobody may not read and write {device}, which belongs to group ")
    assert do.startswith("sudo usermod -a -G ")
    assert do.endswith(" nobody, then log out and in again")


@pytest.mark.parametrize(
    ("query", "verdict", "says"),
    [("", "look", "states no baud rate"), ("?baud=9700", "look", "not a usual speed"), ("?baud=19200", "ok", "19200")],
)
def test_a_speed_that_is_missing_or_odd_is_a_warning(query: str, verdict: str, says: str) -> None:
    finding = _of(f"serial:///dev/null{query}")["speed"]
    assert (finding.verdict, says in finding.message) == (verdict, True)
    assert "9700" not in query or finding.do == "was 9600 meant?"


def test_a_slow_ftdi_adapter_is_a_warning_with_the_command_that_makes_it_quick(tmp_path: Path) -> None:
    timer = tmp_path / "sys/class/tty/ttyUSB3/device/latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    finding = latency_finding("chamber", "/dev/ttyUSB3", tmp_path)
    assert finding is not None
    assert finding.verdict == "look"
    assert "16 ms" in finding.message
    assert finding.do.startswith("echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB3/latency_timer; ")
    timer.write_text("1\n")
    assert getattr(latency_finding("chamber", "/dev/ttyUSB3", tmp_path), "verdict", None) == "ok"
    assert latency_finding("chamber", "/dev/ttyUSB4", tmp_path) is None


@pytest.mark.parametrize(
    ("owner", "groups", "entered", "do"),
    [
        (DIALOUT, [1000], False, "sudo usermod -a -G dialout ann, then log out and in again"),
        (Owner(gid=986, group="uucp", group_may=True), [1000], False, "sudo usermod -a -G uucp ann, then log"),
        (DIALOUT, [1000], True, "log out and in again (in this terminal only: newgrp dialout)"),
        (Owner(gid=0, group="root", group_may=True), [1000], False, 'a udev rule, SUBSYSTEM=="tty", KERNEL=="ttyUSB0"'),
        (Owner(gid=5, group="tty", group_may=False), [5], True, "a udev rule"),
    ],
)
def test_who_may_not_use_a_port_is_told_what_to_do(owner: Owner, groups: list[int], entered: bool, do: str) -> None:
    finding = refused_finding("chamber", "/dev/ttyUSB0", owner, "ann", groups, entered=entered)
    assert finding.verdict == "bad"
    assert finding.do.startswith(do)
    assert finding.message.startswith(f"ann may not read and write /dev/ttyUSB0, which belongs to group {owner.group}")


@needs_proc
def test_who_holds_a_device_is_found_and_this_process_is_left_out() -> None:
    with terminal() as device:
        assert holders(device)[0] == []
        with held(device) as pid, held(device) as other:
            assert {process.pid for process in holders(device)[0]} == {pid, other}
    assert holders("/dev/there-is-none") == ([], 0)


@needs_proc
def test_the_other_end_of_a_pseudo_terminal_holds_nothing() -> None:
    code = (
        "import os, sys\nmaster, slave = os.openpty()\nprint(os.ttyname(slave), flush=True)\n"
        "keep = os.open(os.ttyname(slave), os.O_RDWR)\nsys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        device = server.stdout.readline().strip()
        with held(device) as pid:
            assert [process.pid for process in holders(device)[0]] == [pid]
        server.kill()


def _adapter() -> ListPortInfo:
    port = ListPortInfo("/dev/ttyUSB0")
    port.vid, port.pid, port.serial_number = 0x0403, 0x6001, "A50285BI"
    port.manufacturer, port.product = "FTDI", "FT232R USB UART"
    return port


def test_an_adapter_is_told_by_its_numbers_and_words() -> None:
    assert described(_adapter()) == "USB 0403:6001 FTDI FT232R USB UART, serial number A50285BI"
    assert described(ListPortInfo("/dev/ttyS0")) == "no USB adapter, or one without a description"


def test_the_name_that_stays_is_the_link_to_the_device(tmp_path: Path) -> None:
    device, folder = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.write_text("")
    folder.mkdir()
    (folder / "usb-another").symlink_to(tmp_path / "ttyUSB1")
    (folder / "usb-FTDI_A50285BI-if00").symlink_to("../ttyUSB0")
    assert lasting_name(str(device), folder) == folder / "usb-FTDI_A50285BI-if00"
    assert lasting_name(str(tmp_path / "ttyUSB7"), folder) is None
    assert lasting_name(str(device), tmp_path / "absent") is None


@needs_proc
def test_services_that_open_adapters_are_named_while_they_run(tmp_path: Path) -> None:
    assert [finding.verdict for finding in seizing_findings(tmp_path)] == ["ok"]
    for name in ("ModemManager", "brltty"):
        shutil.copy(shutil.which("sleep") or "", tmp_path / name)
    with (
        subprocess.Popen(["./ModemManager", "60"], cwd=tmp_path) as manager,
        subprocess.Popen(["./brltty", "60"], cwd=tmp_path) as braille,
    ):
        found = list(seizing_findings(tmp_path))
        manager.kill()
        braille.kill()
    assert [(finding.what, finding.verdict) for finding in found] == [("ModemManager", "look"), ("brltty", "look")]
    assert found[0].message.startswith(f"process {manager.pid} (./ModemManager 60) runs: ")
    assert found[0].do.startswith("sudo systemctl disable --now ModemManager")
    assert found[1].message.startswith("runs: ")
    unit = tmp_path / "usr/lib/systemd/system/brltty-udev.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("")
    assert next(seizing_findings(tmp_path)).message.startswith("is installed: ")


def test_the_ports_of_this_machine_are_listed() -> None:
    found = list(port_findings(serial_wanted=False))
    assert found
    assert {finding.where for finding in found} == {"ports"}
