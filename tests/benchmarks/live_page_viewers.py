"""What the live page costs a run: `python -m tests.benchmarks.live_page_viewers`.

The same simulated campaign, same seed, is run by turns alone and with `benchctl serve` beside it and viewers on its
websocket, each of whom wants five channels drawn four times a second. Printed are medians of the runner's wall time and
of its own processor time (user and system, as the system counted it for that process; its guard's is not in it), what
the viewers cost of its time, whether every sample is the same, and what the server itself took. The simulated bench
leaves the runner no time in which it waits, so whatever the viewers cost shows. With `--real-time` the bench is one of
servers that take as long as a real one (`benchctl sim`), at rest: what a laboratory's runner feels. The viewers share
the machine with the run, which those of a laboratory do not: they give way to it, as the server does.
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
BENCHCTL = (sys.executable, "-m", "benchctl")
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
    gaps: int
    digests: tuple[str, ...]
    server_s: float = 0.0
    states: int = 0


def main() -> None:
    """Run by turns, and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--turns", type=int, default=5, help="runs alone, and as many with viewers")
    parser.add_argument("--viewers", type=int, default=10)
    parser.add_argument("--run-s", type=float, default=240.0, help="of each rate, or at rest: how long the campaign is")
    parser.add_argument("--real-time", action="store_true", help="on a bench that takes as long as a real one")
    arguments = parser.parse_args()
    alone: list[Ran] = []
    watched: list[Ran] = []
    for turn in range(arguments.turns):
        for those, viewers in ((alone, 0), (watched, arguments.viewers))[:: 1 if turn % 2 else -1]:
            with tempfile.TemporaryDirectory() as folder, campaign(Path(folder), arguments) as command:
                those.append(run_watched(Path(folder), command, viewers) if viewers else run(Path(folder), command))
            told = "alone" if those is alone else "watched"
            print(f"{told}: {those[-1].wall_s:.1f} s, processor {those[-1].processor_s:.2f} s", file=sys.stderr)  # noqa: T201
    print(table(alone, watched, arguments.viewers))  # noqa: T201


@contextmanager
def campaign(folder: Path, arguments: argparse.Namespace) -> Iterator[tuple[str, ...]]:
    """What `benchctl run` is told of the campaign; in real time its bench is there while the block runs."""
    if not arguments.real_time:
        yield (
            "rate_sweep",
            "--bench",
            "simulated",
            "--seed",
            "7",
            "-p",
            f"run_s={arguments.run_s}",
            "-p",
            "verify=false",
        )
        return
    bench = folder / "bench.toml"
    serve = (*BENCHCTL, "sim", "--bench", "simulated", "--seed", "7", "--write-bench", str(bench))
    with subprocess.Popen(serve, stdout=subprocess.PIPE) as servers:
        try:
            assert servers.stdout is not None
            servers.stdout.readline()  # they answer
            yield (
                "static",
                "--bench",
                str(bench),
                "-p",
                "at_c=23",
                "-p",
                "soak_s=1",
                "-p",
                f"duration_s={arguments.run_s}",
            )
        finally:
            servers.terminate()


def run_watched(folder: Path, command: Sequence[str], viewers: int) -> Ran:
    """Run the campaign with a server beside it and so many viewers."""
    with serving(folder, folder / "cache") as served:
        with crowd(served, viewers) as states:
            ran = run(folder, command)
        return replace(ran, server_s=processor_s_of(served.process.pid), states=states.value)


def run(folder: Path, told: Sequence[str]) -> Ran:
    """Run the campaign in a process of its own."""
    result = folder / "run.json"
    command = (*BENCHCTL, "run", *told, "--quiet", "--out", str(folder / NAME), "--json", str(result))
    began_s = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began_s
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit status {process.returncode}")
    with open_recording(folder / NAME) as recording:
        digests = tuple(info.digest for info in recording.infos)
        gaps = sum(info.gaps for info in recording.infos)
    samples = json.loads(result.read_text())["samples"]
    processor_s = usage.ru_utime + usage.ru_stime
    return Ran(wall_s=wall_s, processor_s=processor_s, samples=samples, gaps=gaps, digests=digests)


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
    everyone = (*alone, *watched)
    same = len({(ran.samples, ran.digests) for ran in everyone}) == 1
    cost_s = statistics.median(ran.processor_s for ran in watched) - statistics.median(ran.processor_s for ran in alone)
    a_second = [ran.states / viewers / ran.wall_s for ran in watched]
    return "\n".join(
        [
            f"| the runner: median (least to most) of {len(alone)} | alone | {viewers} viewers | more |",
            "|---|---|---|---|",
            *rows,
            "",
            f"The viewers cost {cost_s / statistics.median(ran.wall_s for ran in alone):+.2%} of the runner's time.",
            f"{min(ran.samples for ran in everyone):,} samples or more, {sum(ran.gaps for ran in everyone)} gaps; "
            f"{'' if same else 'not '}the same in every run, bit by bit. States sent to each viewer: "
            f"{statistics.median(a_second):.1f} a second; processor time of the server: "
            f"{statistics.median(ran.server_s for ran in watched):.1f} s. The aim: at most {LIMIT:.0%} more.",
        ]
    )


def _spread(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


if __name__ == "__main__":
    main()
