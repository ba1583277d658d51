"""`[gyro]` in bench.toml: read, refused in one line, priced, reserved, and absent where it is not there."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest

from benchctl.bench import Bench, load_bench, template
from benchctl.campaign.check import room_problems
from benchctl.campaign.opened import driver_at, open_bench
from benchctl.campaign.reserved import reserved
from benchctl.cli.sim import _write_bench
from benchctl.plan import Plan, Static
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.clock import VirtualClock
from tests.benchctl.lock_place import own_lock_place

GYRO = """
[gyro]
model = "sensonor_stim300"
serial = "DG-1"
calibrated_until = 2027-01-31
frame_rate_hz = 250.0
sign = -1
[gyro.options]
axis = "x"
"""


def bench_with(tmp_path: Path, tables: str, text: str = "") -> Bench:
    path = tmp_path / "bench.toml"
    path.write_text((text or template()) + tables, encoding="utf-8")
    return load_bench(str(path))


def test_a_digital_gyro_is_read_like_the_other_instruments(tmp_path: Path) -> None:
    gyro = bench_with(tmp_path, GYRO).gyro
    assert gyro is not None
    assert (gyro.model, gyro.serial, gyro.frame_rate_hz, gyro.sign) == ("sensonor_stim300", "DG-1", 250.0, -1)
    assert gyro.calibrated_until == datetime.date(2027, 1, 31)
    assert gyro.options == {"axis": "x"}
    assert load_bench("simulated").gyro is None


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ('[gyro]\nserial = "1"', "gyro.model: this field is needed and is not there"),
        ('[gyro]\nmodel = "kvh_dsp1760"\nsign = 2', "gyro.sign: expected 1 or -1"),
        ('[gyro]\nmodel = "kvh_dsp1760"\nframe_rate_hz = 0.0', "gyro.frame_rate_hz: expected a number above 0"),
        ('[gyro]\nmodel = "kvh_dsp1760"\naxis = "z"', "gyro.axis: there is no such field"),
        ('[[faults]]\non = "gyro"\nkind = "frame_lost"', "there is no \\[gyro\\]"),
        ('[gyro]\nmodel = "kvh_dsp1760"\n[[faults]]\non = "gyro"\nkind = "silence"', "not on gyro"),
        ('[gyro]\nmodel = "kvh_dsp1760"\n[[faults]]\non = "chamber"\nkind = "frame_lost"', "not on chamber"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(tmp_path: Path, tables: str, says: str) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        bench_with(tmp_path, tables)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ('[gyro]\nmodel = "kvh_dsp1670"', "there is no twin of|did you mean kvh_dsp1760"),
        ('[gyro]\nmodel = "kvh_dsp1760"\n[gyro.options]\naxis = "up"', "axis 'up'"),
        ('[gyro]\nmodel = "sensonor_stim300"\nframe_rate_hz = 300.0', "a simulated STIM300 has one of"),
        ('[gyro]\nmodel = "kvh_dsp1760"\nframe_rate_hz = 300.0', "a simulated KVH DSP-1760 has one of"),
    ],
)
def test_a_gyro_that_cannot_be_is_refused_before_anything_moves(tmp_path: Path, tables: str, says: str) -> None:
    with pytest.raises(UsageError, match=says), open_bench(bench_with(tmp_path, tables)):
        pass


def test_a_rate_that_a_real_gyro_does_not_have_is_refused_before_any_instrument_is_asked(tmp_path: Path) -> None:
    bench = bench_with(tmp_path, '[gyro]\nmodel = "kvh_dsp1760"\nframe_rate_hz = 125.0')
    with pytest.raises(UsageError, match=r"^gyro\.frame_rate_hz = 125: .* kvh_dsp1760, 1, 5, 10, .*, 750, 1000 Hz$"):
        driver_at(bench, "gyro", VirtualClock(), {"gyro": "socket://127.0.0.1:9"})


def test_a_simulation_without_wires_has_no_line_for_frames_and_says_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"leave \[gyro\] out"), open_bench(bench_with(tmp_path, GYRO), wires=False):
        pass


def test_a_real_gyro_needs_an_address_and_is_one_process_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own_lock_place(tmp_path, monkeypatch)
    text = template().replace("simulated = true", "simulated = false")
    for name in ("rate_table", "chamber", "digitizer"):
        text = text.replace(f"[{name}]\n", f'[{name}]\naddress = "tcp://{name}:502"\n')
    with pytest.raises(UsageError, match=r"gyro\.address must be given"):
        bench_with(tmp_path, GYRO, text)
    address = 'serial = "DG-1"\naddress = "serial:///dev/ttyS9?baud=460800"'
    bench = bench_with(tmp_path, GYRO.replace('serial = "DG-1"', address), text)
    alone = bench.model_copy(
        update={
            name: getattr(bench, name).model_copy(update={"address": f"tcp://other-{name}:1"})
            for name in ("rate_table", "chamber", "digitizer")
        }
    )
    refused = pytest.raises(UsageError, match=r"^gyro at serial:///dev/ttyS9")
    with reserved(bench, "a campaign"), refused, reserved(alone, "another"):
        pass


def test_the_bench_file_that_sim_writes_reaches_the_gyro(tmp_path: Path) -> None:
    names = ("rate_table", "chamber", "digitizer", "gyro")
    _write_bench(tmp_path / "sim.toml", bench_with(tmp_path, GYRO), {name: f"tcp://{name}:1" for name in names}, 5.0)
    gyro = load_bench(str(tmp_path / "sim.toml")).gyro
    assert gyro is not None
    assert (gyro.address, gyro.model, gyro.options) == ("tcp://gyro:1", "sensonor_stim300", {"axis": "x"})


def test_frames_need_room_on_the_disk_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Plan(procedure="mine", parameters={}, steps=(Static(duration_s=1000.0),), calibrates=False)
    monkeypatch.setattr("benchctl.campaign.check.free_bytes", lambda folder: 40e6)
    assert room_problems(plan, load_bench("simulated"), tmp_path) == []
    assert "the disk would be full" in room_problems(plan, bench_with(tmp_path, GYRO), tmp_path)[0].message
