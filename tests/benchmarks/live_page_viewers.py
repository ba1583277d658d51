"""What the live page costs a run: `python -m tests.benchmarks.live_page_viewers`.

The same simulated campaign, same seed, is run by turns alone and with `benchctl serve` beside it and viewers on its
websocket, each of whom wants five channels drawn four times a second. Printed are medians of the runner's wall time and
of its own processor time (user and system, as the system counted it for that process; its guard's is not in it),
whether every sample is the same, and what the server itself took. The simulated bench leaves the runner no time in
which it waits, so whatever the viewers cost shows; on a bench in real time it mostly does wait. The viewers share the
machine with the run, which those of a laboratory do not: they give way to it, as the server does.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

import httpx
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from benchctl.recordings.reader import open_recording
from tests.benchctl.dashboard.web.serving import Served, serving

LIMIT = 0.02
NAME = "campaign"
WATCH = {
    "watch": {
        "channels": ["rate_dps", "gyro_v", "gyro_temp_c", "poll_chamber_temp_c", "encoder_deg"],
        "window_s": 3600,
        "pixels": 800,
    }
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """One run: its times [s], the digests of its steps; what the server beside it took [s], how many states it sent."""

    wall_s: float
    processor_s: float
    samples: int
    digests: tuple[str, ...]
    server_s: float = 0.0
    states: int = 0


def main() -> None:
    """Run by turns, and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--turns", type=int, default=5, help="runs alone, and as many with viewers")
    parser.add_argument("--viewers", type=int, default=10)
    parser.add_argument("--run-s", type=float, default=240.0, help="of each rate: how long the campaign is")
    arguments = parser.parse_args()
    alone: list[Ran] = []
    watched: list[Ran] = []
    for turn in range(arguments.turns):
        runs = [(alone, run_alone), (watched, lambda run_s: run_watched(run_s, arguments.viewers))]
        for those, run in runs if turn % 2 else reversed(runs):
            those.append(run(arguments.run_s))
            told = "alone" if those is alone else "watched"
            print(f"{told}: {those[-1].wall_s:.1f} s, processor {those[-1].processor_s:.2f} s", file=sys.stderr)  # noqa: T201
    print(table(alone, watched, arguments.viewers))  # noqa: T201


def run_alone(run_s: float) -> Ran:
    """Run the campaign with nobody beside it."""
    with tempfile.TemporaryDirectory() as folder:
        return run(Path(folder), run_s)


def run_watched(run_s: float, viewers: int) -> Ran:
    """Run the campaign with a server beside it and so many viewers."""
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), Path(folder) / "cache") as served:
        with crowd(served, viewers) as states:
            ran = run(Path(folder), run_s)
        return replace(ran, server_s=processor_s_of(served.process.pid), states=states.value)


def run(folder: Path, run_s: float) -> Ran:
    """Run the campaign in a process of its own."""
    result = folder / "run.json"
    command = (
        *(sys.executable, "-m", "benchctl", "run", "rate_sweep", "--bench", "simulated", "--seed", "7", "--quiet"),
        *("-p", f"run_s={run_s}", "-p", "verify=false", "--out", str(folder / NAME), "--json", str(result)),
    )
    began_s = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began_s
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit status {process.returncode}")
    with open_recording(folder / NAME) as recording:
        digests = tuple(info.digest for info in recording.infos)
    samples = json.loads(result.read_text())["samples"]
    return Ran(wall_s=wall_s, processor_s=usage.ru_utime + usage.ru_stime, samples=samples, digests=digests)


@contextmanager
def crowd(served: Served, viewers: int) -> Iterator[Synchronized[int]]:
    """Viewers in a process of their own while the block runs; counts the states that all of them were sent."""
    spawn = multiprocessing.get_context("spawn")
    states: Synchronized[int] = spawn.Value("q", 0)
    process = spawn.Process(target=watch, args=(served.url, served.view_token, viewers, states))
    process.start()
    try:
        yield states
    finally:
        process.terminate()
        process.join()


def watch(url: str, token: str, viewers: int, states: Synchronized[int]) -> None:
    """Wait for the campaign to begin, then watch it with so many viewers until it is over."""
    os.nice(10)
    headers = {"Authorization": f"Bearer {token}"}
    with httpx.Client(base_url=url, headers=headers) as client:
        while not (listed := client.get("/api/campaigns").json()["campaigns"]):
            time.sleep(0.1)
    address = f"{url.replace('http', 'ws', 1)}api/campaigns/{listed[0]['id']}/live"

    async def one() -> None:
        async with connect(address, additional_headers=headers, proxy=None) as socket:
            await socket.send(json.dumps(WATCH))
            async for _ in socket:
                states.value += 1

    async def all_of_them() -> None:
        await asyncio.gather(*(one() for _ in range(viewers)))

    try:
        asyncio.run(all_of_them())
    except ConnectionClosed:  # the campaign is over
        return


def processor_s_of(pid: int) -> float:
    """Processor time that a process has taken so far [s], user and system, as Linux says it."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def table(alone: Sequence[Ran], watched: Sequence[Ran], viewers: int) -> str:
    """The medians, and how they compare, as Markdown."""
    rows = [
        f"| {what} | {_spread(one)} | {_spread(other)} | {statistics.median(other) / statistics.median(one) - 1:+.1%} |"
        for what, one, other in (
            ("wall time [s]", [ran.wall_s for ran in alone], [ran.wall_s for ran in watched]),
            ("own processor time [s]", [ran.processor_s for ran in alone], [ran.processor_s for ran in watched]),
        )
    ]
    same = {(ran.samples, ran.digests) for ran in (*alone, *watched)}
    a_second = [ran.states / viewers / ran.wall_s for ran in watched]
    return "\n".join(
        [
            f"| the runner: median (least to most) of {len(alone)} | alone | {viewers} viewers | more |",
            "|---|---|---|---|",
            *rows,
            "",
            f"{alone[0].samples:,} samples; "
            f"{'the same in every run, bit by bit' if len(same) == 1 else f'{len(same)} DIFFERENT RECORDINGS'}. "
            f"States sent to each viewer: {statistics.median(a_second):.1f} a second; processor time of the server: "
            f"{statistics.median(ran.server_s for ran in watched):.1f} s. The aim: at most {LIMIT:.0%} more.",
        ]
    )


def _spread(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


if __name__ == "__main__":
    main()
