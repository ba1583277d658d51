"""A recording twice as large as the memory that its fit may have is no special case."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.recordings import stored
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from tests.benchctl.calibration.synthetic import Truth, meta_of, steps, two_stage

LIMIT_MIB = 500
_STEP_S = 65.0

_FIT_IN_LITTLE = """
import json, os, resource, sys
from pathlib import Path
from benchctl.calibration.calibrate import calibrate
from benchctl.recordings.reader import open_recording
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
resource.setrlimit(resource.RLIMIT_DATA, (int(sys.argv[2]) << 20,) * 2)
try:
    bytearray(int(sys.argv[2]) << 20)
except MemoryError:
    with open_recording(Path(sys.argv[1])) as recording:
        result = calibrate(recording.stored_steps(), recording.meta)
    print(json.dumps({each.name: [each.value, each.standard] for each in result.best.parameters}))
"""


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds a process to a limit of its data")
def test_a_fit_in_half_of_the_memory_gives_the_coefficients_of_one_piece(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The encoder's terms and the delay rest on its counts, too, which average out by where the blocks lie."""
    truth, path = Truth(fs=19_937.0), tmp_path / "large.h5"
    asks = two_stage(temperatures=(-40.0, 20.0, 60.0), rates=(40.0, 80.0, 120.0, 160.0))
    long = [replace(ask, seconds=_STEP_S) for ask in asks]
    write_recording(path, meta_of(truth), steps(truth, long, seed=3))
    with open_recording(path) as recording:
        samples = sum(step.scans * 4 for step in recording.stored_steps())
    assert 8 * samples > 2 * LIMIT_MIB * 2**20

    command = (sys.executable, "-c", _FIT_IN_LITTLE, str(path), str(LIMIT_MIB))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)

    monkeypatch.setattr(stored, "SCANS_AT_ONCE", 1 << 40)
    with open_recording(path) as recording:
        whole = calibrate(recording.stored_steps(), recording.meta)
    assert found.keys() == {parameter.name for parameter in whole.best.parameters}
    for parameter in whole.best.parameters:
        value, standard = found[parameter.name]
        by_counts = parameter.name == "delay_s" or parameter.name.startswith("encoder_")
        allowed = 2.0 * math.hypot(standard, parameter.standard) if by_counts else 0.3 * parameter.standard
        assert abs(value - parameter.value) < allowed, parameter.name
