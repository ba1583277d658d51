"""How quickly the live page sees a large campaign, and what it costs a run that goes on: `python -m ... --help`.

First a recording of 10^8 scans of four channels is made, in a temporary folder, and looked at as a page does: the list,
the details, the whole of it before there is any overview, then windows of any length anywhere. Then the same simulated
campaign is run again and again, by turns with nobody looking and with ten viewers, each with a window of their own.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchctl.dashboard.data.catalogue import Catalogue
from benchctl.dashboard.data.details import details_of
from benchctl.dashboard.data.follower import Follower, Watch
from benchctl.dashboard.data.series import SeriesReader
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.schema import STEPS
from benchctl.recordings.writer import write_recording
from tests.benchctl.recordings import made
from tests.benchmarks.memory import peak_bytes

T = TypeVar("T")

VIEW_LIMIT_S = 1.0
MEMORY_LIMIT_BYTES = 1 << 30
COST_LIMIT = 0.02
PIXELS = 1200
CHANNELS = ("gyro_v", "rate_dps", "gyro_temp_c", "encoder_deg", "air_c")
_STEPS = 10
_RATE_HZ = 1000.0
_ADC_STEP_V = 20.0 / 2**16
_RUN = ("run", "two_stage", "--bench", "simulated", "--quiet", "-p", "points=5", "-p", "soak_s=1200")


def campaign(scans: int) -> Iterator[Step]:
    """Ten steps at ten rates: a gyro with white noise behind a converter of 16 bits, an encoder of 360,000 counts."""
    chance = np.random.default_rng(1)
    begin_s = 0.0
    for index in range(1, _STEPS + 1):
        count = scans // _STEPS
        time_s = begin_s + np.arange(count) / _RATE_HZ
        rate_dps = 15.0 * index * (-1) ** index
        volts = 2.5 + 0.02 * rate_dps + chance.normal(scale=6e-4, size=count)
        celsius = 20.0 + 5.0 * np.sin(time_s / 9000.0) + chance.normal(scale=2e-3, size=count)
        channels = {
            "time_s": time_s,
            "encoder_deg": np.mod(np.rint(rate_dps * time_s * 1000.0) / 1000.0, 360.0),
            "gyro_v": np.rint(volts / _ADC_STEP_V) * _ADC_STEP_V,
            "gyro_temp_c": np.rint(celsius / 6e-3) * 6e-3,
            **made.polled(begin_s, max(2, int(count / _RATE_HZ / 5.0))),
        }
        info = made.info(index, t_start=begin_s, t_end=float(time_s[-1]) + 1.0 / _RATE_HZ, sample_rate_hz=_RATE_HZ)
        yield Step(info, channels)
        begin_s = info.t_end + 60.0


def look(folder: Path, views: int) -> None:
    """Look at the campaign in a folder as a page does, and print how long everything takes."""
    catalogue, took_s = Catalogue(folder, folder / "cache"), []
    with SeriesReader(folder / "cache") as reader:
        entry = _timed("list", took_s, catalogue.list)[0]
        path = catalogue.find(entry["id"])
        assert path is not None
        details = _timed("details", took_s, lambda: details_of(path))
        end_s = details["t_end_s"]
        began_s = time.perf_counter()
        first = _timed("first view of all of it", took_s, lambda: reader.view(path, "gyro_v", 0.0, end_s, PIXELS))
        while not reader.view(path, "gyro_v", 0.0, end_s, PIXELS)["complete"]:
            time.sleep(0.1)
        say(f"complete after {time.perf_counter() - began_s:.1f} s (the first view said {first['done']:.2f})")
        reader.prepare(path)
        while not all(reader.view(path, name, 0.0, end_s, PIXELS)["complete"] for name in CHANNELS):
            time.sleep(0.1)
        say(f"every channel complete after {time.perf_counter() - began_s:.1f} s")
        chance = np.random.default_rng(2)
        zoomed_s = []
        for _ in range(views):
            width_s = end_s * 10.0 ** chance.uniform(-np.log10(end_s * _RATE_HZ), 0.0)
            from_s = chance.uniform(0.0, end_s - width_s)
            began_s = time.perf_counter()
            reader.view(path, str(chance.choice(CHANNELS)), from_s, from_s + width_s, PIXELS)
            zoomed_s.append(time.perf_counter() - began_s)
    say(
        f"{views} windows from all of it to single samples: median {statistics.median(zoomed_s):.3f} s, "
        f"the slowest {max(zoomed_s):.3f} s: {max([*zoomed_s, *took_s]) / VIEW_LIMIT_S:.2f} of {VIEW_LIMIT_S:g} s"
    )
    if (peak := peak_bytes()) is not None:
        say(f"peak memory {peak / 2**20:.0f} MiB: {peak / MEMORY_LIMIT_BYTES:.2f} of 1 GiB")


def follow(folder: Path) -> None:
    """Ten viewers of one campaign until it is over, four looks a second, at the lowest priority, as `serve` has it."""
    os.nice(10)
    while not (folder / STEPS).is_dir():
        time.sleep(0.05)
    follower = Follower(folder)
    watches = [Watch(CHANNELS, 60.0 * (number + 1), 600 + 50 * number) for number in range(10)]
    looks, slowest_s = 0, 0.0
    while True:
        began_s = time.perf_counter()
        found = follower.look(watches)
        for series in found["series"]:
            json.dumps({**found, "series": series})
        slowest_s = max(slowest_s, time.perf_counter() - began_s)
        looks += 1
        if found["status"] != "running":
            break
        time.sleep(0.25)
    say(f"    {looks} looks, the slowest {slowest_s:.2f} s, {time.process_time():.1f} s of processor time")


def cost(folder: Path, pairs: int) -> None:
    """Run a campaign by turns alone and watched, and print what watching costs and whether a sample differs."""
    alone: list[tuple[float, float]] = []
    watched: list[tuple[float, float]] = []
    samples = set()
    for number in range(pairs):
        for times, viewers in ((alone, False), (watched, True)):
            place = folder / f"run_{number}_{viewers}"
            times.append(_run(place, viewers=viewers))
            with open_recording(place) as recording:
                samples.add(tuple((info.name, info.samples, info.gaps) for info in recording.infos))
    for what, column in (("wall time", 0), ("processor time", 1)):
        before, after = ([one[column] for one in times] for times in (alone, watched))
        share = statistics.median(after) / statistics.median(before) - 1.0
        say(
            f"{what} of the run alone {_listed(before)} s, with ten viewers {_listed(after)} s: {100 * share:+.1f} %, "
            f"{share / COST_LIMIT:.2f} of 2 %"
        )
    say("every run has the same samples" if len(samples) == 1 else "SAMPLES DIFFER FROM RUN TO RUN")


def _run(place: Path, *, viewers: bool) -> tuple[float, float]:
    """Wall and processor time of a run."""
    command = [sys.executable, "-m", "benchctl", *_RUN, "--out", str(place)]
    watch = [sys.executable, "-m", "tests.benchmarks.live_page_views", "--follow", str(place)]
    watching = subprocess.Popen(watch) if viewers else None
    before = _children_s()
    try:
        took_s = _seconds(lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL))
        return took_s, _children_s() - before
    finally:
        if watching is not None:
            watching.wait()


def _children_s() -> float:
    """Processor time of the processes that were waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _timed(what: str, took_s: list[float], act: Callable[[], T]) -> T:
    began_s = time.perf_counter()
    found = act()
    took_s.append(time.perf_counter() - began_s)
    say(f"{what}: {took_s[-1]:.3f} s")
    return found


def _seconds(act: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    act()
    return time.perf_counter() - began_s


def _listed(times: Sequence[float]) -> str:
    return ", ".join(f"{one:.1f}" for one in times)


def say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


def main() -> None:
    """Print each figure beside its limit, as a ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=float, default=1e8, help="scans of the large campaign; 0: none")
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--pairs", type=int, default=3, help="runs alone and watched, by turns; 0: none")
    parser.add_argument("--make", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--follow", type=Path, help=argparse.SUPPRESS)
    told = parser.parse_args()
    if told.follow is not None:
        follow(told.follow)
        return
    if told.make is not None:
        write_recording(told.make, made.meta(), campaign(round(told.samples)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if told.samples:
            large = folder / "large"
            large.mkdir()
            # in a process of its own: the memory that is measured is that of looking, not of making
            make = [sys.executable, "-m", "tests.benchmarks.live_page_views", "--samples", str(told.samples)]
            took_s = _seconds(lambda: subprocess.run([*make, "--make", str(large / "large.h5")], check=True))
            size = (large / "large.h5").stat().st_size
            say(f"{told.samples:,.0f} scans of four channels made in {took_s:.0f} s, {size / 1e6:.0f} MB")
            look(large, told.views)
        if told.pairs:
            cost(folder, told.pairs)


if __name__ == "__main__":
    main()
