"""The processes of a trial."""

import threading
import time
from pathlib import Path

import pytest

from benchctl.campaign.stop import StoppedError, StopRequest
from benchctl.proof.processes import ProcessFailedError, run_module


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


def test_what_a_process_prints_is_returned_and_its_arithmetic_has_one_thread(
    modules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    (modules / "speaks.py").write_text("import os, sys\nprint(sys.argv[1], os.environ['OPENBLAS_NUM_THREADS'])\n")
    assert run_module("speaks", "hello", stop=StopRequest(), longest_s=20.0) == "hello 1\n"


def test_a_process_that_fails_says_why_in_its_last_line(modules: Path) -> None:
    (modules / "fails.py").write_text("import sys\nsys.stderr.write('first\\nno gyro there\\n')\nsys.exit(2)\n")
    with pytest.raises(ProcessFailedError, match=r"^no gyro there$"):
        run_module("fails", stop=StopRequest(), longest_s=20.0)


def test_a_process_that_takes_too_long_is_ended(modules: Path) -> None:
    (modules / "sleeps.py").write_text("import time\ntime.sleep(60)\n")
    began_s = time.monotonic()
    with pytest.raises(ProcessFailedError, match=r"no answer after 0.5 s"):
        run_module("sleeps", stop=StopRequest(), longest_s=0.5)
    assert time.monotonic() - began_s < 8.0


def test_a_wish_to_stop_ends_the_process(modules: Path) -> None:
    left = modules / "left"
    (modules / "sleeps.py").write_text(f"import time\ntime.sleep(1.5)\nopen({str(left)!r}, 'w').close()\n")
    stop = StopRequest()
    threading.Timer(0.5, stop.ask, ["Ctrl-C"]).start()
    with pytest.raises(StoppedError, match=r"stopped by Ctrl-C"):
        run_module("sleeps", stop=stop, longest_s=20.0)
    time.sleep(1.5)
    assert not left.exists()
