import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.doctor.finding import Finding
from benchctl.doctor.ports.port import findings_of_port, latency_finding
from benchctl_instruments.links.address import parse_address
from tests.benchctl.doctor.ports.ptys import held, terminal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="ports of POSIX")

AS_NOBODY = """
import os, sys
from benchctl.doctor.ports.port import findings_of_port
from benchctl_instruments.links.address import parse_address
import grp, pwd
address = parse_address(sys.argv[1])
os.setgroups([]); os.setgid(65534); os.setuid(65534)
for each in findings_of_port("chamber", address):
    print(each.verdict, each.what, each.says, each.do, sep="|")
"""


def _of(address: str) -> dict[str, Finding]:
    return {finding.what: finding for finding in findings_of_port("chamber", parse_address(address))}


def test_a_free_port_that_is_permitted_is_fine() -> None:
    with terminal() as device:
        found = _of(f"serial://{device}?baud=9600")
    assert (found["port"].verdict, found["speed"].says) == ("ok", "9600 baud, 8N1")
    assert f"{device}: there, may be read and written, and nobody has it open" in found["port"].says


def test_a_port_that_is_not_there_names_those_that_are() -> None:
    finding = _of("serial:///dev/ttyUSB77?baud=9600")["port"]
    assert finding.verdict == "bad"
    assert finding.says.startswith("/dev/ttyUSB77: there is no such port; ")
    assert finding.do.startswith("plug the adapter in")


def test_what_is_no_port_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "is no port but a file" in _of(f"serial://{tmp_path}/file?baud=9600")["port"].says
    assert "is no port but a folder" in _of(f"serial://{tmp_path}?baud=9600")["port"].says


def test_the_process_that_has_a_port_open_is_named() -> None:
    with terminal() as device, held(device) as pid:
        finding = _of(f"serial://{device}?baud=9600")["port"]
    assert finding.verdict == "bad"
    assert f"{device} is in use by process {pid} ({sys.executable} -c import os" in finding.says
    assert finding.do == f"end it: kill {pid}, or wait until it is done"


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
    assert says.startswith(f"nobody may not read and write {device}, which is of group ")
    assert do.startswith("sudo usermod -a -G ")
    assert do.endswith(" nobody, then log out and in again")


@pytest.mark.parametrize(
    ("query", "verdict", "says"),
    [("", "look", "does not say how fast"), ("?baud=9700", "look", "no usual speed"), ("?baud=19200", "ok", "19200")],
)
def test_a_speed_that_is_missing_or_odd_is_a_warning(query: str, verdict: str, says: str) -> None:
    finding = _of(f"serial:///dev/null{query}")["speed"]
    assert (finding.verdict, says in finding.says) == (verdict, True)
    assert "9700" not in query or finding.do == "was 9600 meant?"


def test_a_slow_ftdi_adapter_is_a_warning_with_the_command_that_makes_it_quick(tmp_path: Path) -> None:
    timer = tmp_path / "sys/class/tty/ttyUSB3/device/latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    finding = latency_finding("chamber", "/dev/ttyUSB3", tmp_path)
    assert finding is not None
    assert finding.verdict == "look"
    assert "16 ms" in finding.says
    assert finding.do.startswith("echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB3/latency_timer; ")
    timer.write_text("1\n")
    assert getattr(latency_finding("chamber", "/dev/ttyUSB3", tmp_path), "verdict", None) == "ok"
    assert latency_finding("chamber", "/dev/ttyUSB4", tmp_path) is None
