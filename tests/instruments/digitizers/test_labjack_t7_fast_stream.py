"""The driver against a simulated T7 in a process of its own, in real time at 100,000 samples a second; see
`tests.benchmarks.t7_stream`, which does it for ten minutes.
"""

from __future__ import annotations

import dataclasses

import pytest

from benchctl_instruments.simulated.faults.stream_faults import StreamEnds, StreamGap
from tests.benchmarks import t7_stream
from tests.benchmarks.t7_stream import RATE_HZ, SCANS_A_PACKET, Digest, Run, Served, table

SOUND = Run(
    due=256,
    wall_s=0.01024,
    taken=Digest(scans=256, crc=7),
    gaps=0,
    largest_backlog=100,
    reader_cpu_s=0.001,
    reader_peak_bytes=50 * 2**20,
    served=Served(sent=Digest(scans=256, crc=7), cpu_s=0.002, peak_bytes=None),
    ended_by="",
)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_five_seconds_at_100000_samples_a_second_lose_no_scan_and_change_none(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert t7_stream.main(["--seconds", "5"]) == 0
    said = capsys.readouterr().out
    assert "| scans due | 125,056 |" in said
    assert "| scans taken | 125,056 |" in said
    assert "| scans lost | 0 |" in said
    assert "| taken as they were sent, by checksum | yes |" in said


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_packets_that_never_come_are_counted_as_lost_scans_and_one_gap() -> None:
    result = t7_stream.run(1.0, [StreamGap(on="digitizer_stream", nth=100, packets=3)])
    assert (result.lost, result.gaps, result.ended_by) == (3 * SCANS_A_PACKET, 1, "")
    assert result.served.sent.scans == result.due == pytest.approx(RATE_HZ, abs=SCANS_A_PACKET)
    assert not result.sound


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_stream_that_ends_by_itself_is_told_with_what_came_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(t7_stream, "TIMEOUT_S", 1.0)
    result = t7_stream.run(1.0, [StreamEnds(on="digitizer_stream", nth=100)])
    assert result.taken.scans == 99 * SCANS_A_PACKET
    assert "nothing came" in result.ended_by
    assert "| ended by | LabJack T7 at tcp" in table(result)


def test_a_table_names_the_scans_and_their_samples() -> None:
    said = table(SOUND)
    assert "| asked for | 25,000 scans a second of 4 channels, 100,000 samples a second |" in said
    assert "| came | 100,000 samples a second, for 0.0 s |" in said
    assert "| largest backlog | 100 scans, 4 ms |" in said
    assert "| simulated T7 and bench | 19.5% of a processor, at most an unknown amount of memory |" in said
    assert "at least 8,191 scans" in table(dataclasses.replace(SOUND, largest_backlog=8191))


@pytest.mark.parametrize(
    "flaw",
    [
        {"taken": Digest(scans=255, crc=7)},
        {"taken": Digest(scans=256, crc=8)},
        {"gaps": 1},
        {"ended_by": "nothing came within 5 s"},
    ],
)
def test_a_run_with_any_flaw_ends_with_status_1(monkeypatch: pytest.MonkeyPatch, flaw: dict[str, object]) -> None:
    for result, status in ((SOUND, 0), (dataclasses.replace(SOUND, **flaw), 1)):  # type: ignore[arg-type]
        monkeypatch.setattr(t7_stream, "run", lambda seconds, came=result: came)
        assert t7_stream.main([]) == status
