"""One run a bench, whichever bench file names its instruments."""

import tempfile
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.reserved import lock_folder, lock_name, reserved
from benchctl.locks import is_held
from instruments.errors import BenchNotReadyError, UsageError


@pytest.fixture(autouse=True)
def _a_folder_of_the_tests_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def _bench(table: str, chamber: str, digitizer: str) -> Bench:
    bench = load_bench("simulated")
    entries: dict[str, Any] = {
        name: getattr(bench, name).model_copy(update={"address": address})
        for name, address in (("rate_table", table), ("chamber", chamber), ("digitizer", digitizer))
    }
    return bench.model_copy(update={"simulated": False, **entries})


ONE = _bench("tcp://table:1", "serial:///dev/ttyS7?baud=9600", "tcp://t7:502")
OTHER = _bench("tcp://another-table:1", "serial:///dev/ttyS7?baud=19200", "tcp://another-t7:502")


def test_two_benches_that_share_a_chamber_exclude_each_other_and_nothing_is_sent(tmp_path: Path) -> None:
    with reserved(ONE, "campaign /data/c"):
        with (
            pytest.raises(
                UsageError, match=r"^chamber at serial:///dev/ttyS7\?baud=19200 is in use by process \d+ \(cam"
            ),
            open_bench(OTHER),
        ):
            pass
        assert not is_held(tmp_path / "benchctl" / f"{lock_name('tcp://another-table:1')}.lock")
    with reserved(OTHER, "afterwards"):
        assert len(list((tmp_path / "benchctl").glob("*.lock"))) == 3
    assert list((tmp_path / "benchctl").iterdir()) == []


def test_two_instruments_of_a_bench_may_be_on_one_bus(tmp_path: Path) -> None:
    with reserved(_bench("tcp://table:1", "serial:///dev/ttyS7", "serial:///dev/ttyS7"), "a run"):
        assert len(list((tmp_path / "benchctl").glob("*.lock"))) == 2


def test_a_bench_is_given_back_where_its_instruments_do_not_answer(tmp_path: Path) -> None:
    nobody = _bench("tcp://127.0.0.1:1", "tcp://127.0.0.1:2", "tcp://127.0.0.1:3")
    with pytest.raises(BenchNotReadyError, match="rate_table: "), open_bench(nobody):
        pass
    assert list((tmp_path / "benchctl").iterdir()) == []


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("tcp://LAB-7:702", "tcp://lab-7:702", True),
        ("socket://lab-7:702", "tcp://lab-7:702", True),
        ("tcp://lab-7:702", "tcp://lab-7:703", False),
        ("serial:///dev/ttyS1?baud=9600", "serial:///dev/ttyS1?baud=19200", True),
        ("serial:///dev/ttyS1", "serial:///dev/ttyS2", False),
    ],
)
def test_an_instrument_has_one_name_however_its_address_is_written(one: str, other: str, same: bool) -> None:
    assert (lock_name(one) == lock_name(other)) is same


def test_a_link_to_a_port_is_that_port(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to("/dev/ttyS1")
    assert lock_name(f"serial://{tmp_path}/by-id") == lock_name("serial:///dev/ttyS1")


def test_without_a_runtime_folder_the_locks_lie_in_a_folder_of_the_user_among_the_temporary_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert lock_folder().parent == Path(tempfile.gettempdir())
    assert lock_folder().name.startswith("benchctl-")
