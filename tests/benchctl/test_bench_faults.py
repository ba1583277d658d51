"""`[[faults]]` in bench.toml: read, refused in one line, and played on the simulated bench's wires."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.bench import Bench, load_bench, template
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import Plan, Static
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.faults.link_faults import Cut, Silence


def bench_with(tmp_path: Path, tables: str) -> Bench:
    path = tmp_path / "bench.toml"
    path.write_text(template() + tables, encoding="utf-8")
    return load_bench(str(path))


def test_faults_are_read_with_their_schedules_in_their_order(tmp_path: Path) -> None:
    bench = bench_with(
        tmp_path,
        '[[faults]]\non = "chamber"\nkind = "silence"\npattern = "^03"\nevery = 50\nfrom_s = 30.0\n'
        '[[faults]]\non = "rate_table"\nkind = "cut"\nevery_s = 30.0\ntimes = 2\n',
    )
    assert bench.faults == (
        Silence(on="chamber", pattern="^03", every=50, from_s=30.0),
        Cut(on="rate_table", every_s=30.0, times=2),
    )


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (
            'on = "chamber"\nkind = "silenc"',
            "expected kind to be one of 'silence', 'lost_request'",
        ),
        ('on = "chamber"', "kind is needed and is not there"),
        ('kind = "silence"', "faults.0.silence.on: this field is needed and is not there"),
        ('on = "oven"\nkind = "silence"', "expected 'rate_table', 'chamber'"),
        (
            'on = "chamber"\nkind = "slow"\ndelay_s = -1',
            "faults.0.slow.delay_s: expected a number above 0, got -1",
        ),
        ('on = "chamber"\nkind = "silence"\nfor_s = 1', "faults.0.silence.for_s: there is no such field"),
        ('on = "chamber"\nkind = "silence"\npattern = "("', r"'\(' is no regular expression"),
        ('on = "chamber"\nkind = "silence"\nnth = 0', "at least 1, got 0"),
        ('on = "chamber"\nkind = "silence"\nevery_s = nan', "finite number, got nan"),
        ('on = "chamber"\nkind = "silence"\nfrom_s = 9\nto_s = 9', r"from_s \(9\) must be before to_s \(9\)"),
        ('on = "chamber"\nkind = "junk_in"\njunk = "0g"', "junk: non-hexadecimal"),
        ('on = "rate_table"\nkind = "stalls_short"', "stalls_short happens on chamber, not on rate_table"),
        ('on = "digitizer"\nkind = "stream_gap"', "stream_gap happens on digitizer_stream, not on digitizer"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line_that_names_file_line_and_fault(
    tmp_path: Path, table: str, says: str
) -> None:
    with pytest.raises(UsageError, match=says) as refused:
        bench_with(tmp_path, f"[[faults]]\n{table}\n")
    assert "\n" not in str(refused.value)
    assert f"{tmp_path / 'bench.toml'}, line " in str(refused.value)


def test_faults_on_a_real_bench_are_refused(tmp_path: Path) -> None:
    real = template().replace("simulated = true", "simulated = false")
    for name, port in (("acutrol3000", 1), ("watlow_f4t", 2), ("labjack_t7", 3)):
        real = real.replace(f'model = "{name}"', f'model = "{name}"\naddress = "tcp://127.0.0.1:{port}"')
    path = tmp_path / "bench.toml"
    path.write_text(real + '[[faults]]\non = "chamber"\nkind = "silence"\n', encoding="utf-8")
    with pytest.raises(UsageError, match="happen to simulated instruments only, and simulated is not true"):
        load_bench(str(path))


def test_a_fault_that_the_chosen_instrument_cannot_have_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    bench = bench_with(tmp_path, '[[faults]]\non = "chamber"\nkind = "bad_checksum"\n')
    with (
        pytest.raises(UsageError, match="bad_checksum cannot happen to the chamber that was chosen"),
        open_bench(bench),
    ):
        pass


def test_a_simulation_without_wires_does_not_pretend_to_play_faults(tmp_path: Path) -> None:
    bench = bench_with(tmp_path, '[[faults]]\non = "chamber"\nkind = "silence"\n')
    with pytest.raises(UsageError, match="they happen on wires"), open_bench(bench, wires=False):
        pass


def test_what_was_got_over_in_a_run_stands_in_its_journal(tmp_path: Path) -> None:
    bench = bench_with(
        tmp_path,
        '[[faults]]\non = "chamber"\nkind = "cut"\npattern = "^03 0b 04"\nevery = 2\nfrom_s = 1\nto_s = 16\n'
        '[[faults]]\non = "digitizer_stream"\nkind = "stream_gap"\nfrom_s = 3.0\ntimes = 1\n',
    )
    plan = Plan(procedure="mine", parameters={}, steps=(Static(duration_s=20.0),), calibrates=False)
    with open_bench(bench) as opened:
        outcome = run_campaign(plan, opened, tmp_path / "c")
        assert opened.simulated is not None
        fired = [one.kind for one in opened.simulated.fired]
    with open_recording(outcome.recording) as recording:
        journal = str(recording.meta.provenance["journal"])
        info = recording.infos[0]
    assert outcome.status == "complete"
    assert fired.count("stream_gap") == 1
    assert fired.count("cut") == journal.count('"kind": "recovered"') >= 1
    assert "asked again, it answered" in journal
    assert (info.gaps, info.samples) == (1, 20 * 500 - 25)
