import os
import subprocess
import sys

import pytest

from benchctl.doctor.ports.processes import holders, running
from tests.benchctl.doctor.ports.ptys import held, terminal

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")


def test_who_holds_a_device_is_found_and_this_process_is_left_out() -> None:
    with terminal() as device:
        assert holders(device)[0] == []
        with held(device) as pid, held(device) as other:
            assert {process.pid for process in holders(device)[0]} == {pid, other}
    assert holders("/dev/there-is-none") == ([], 0)


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


def test_a_process_is_found_by_its_name() -> None:
    with open("/proc/self/comm") as file:
        name = file.read().strip()
    found = running(name)
    assert found is not None
    assert os.path.exists(f"/proc/{found.pid}")
    assert running("no such program") is None
