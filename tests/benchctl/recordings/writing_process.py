"""A process that writes a campaign until it is killed: `python -m … FOLDER HOW MUCH`.

`slowly PERIOD_S`: step 1 is finished, step 2 gets five samples every period, stamped with the monotonic clock that all
processes share; the last stamp is printed once `append` has returned.
`fast STEPS`: as many steps as are asked for, then `finish`; prints each index once its step is closed, and `finished`.
`told STEPS`: as `fast`, each step noted as whole; then it waits, and never finishes.
`points BURST`: step 1 gets points one by one, each with the monotonic clock and its number; prints the first stamp, and
the last one of a burst, after which it is silent for a second. With 0 there are some thousands a second without end.
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path

import numpy as np

from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.model import StepInfo
from tests.benchctl.recordings import made


def write_slowly(folder: Path, period_s: float) -> None:
    writer = CampaignWriter(folder, made.meta(status="running"))
    _write_step(writer, 1)
    step = writer.begin_step(made.info(2), made.STREAMED)
    while True:
        stamps = time.monotonic() + np.arange(5) * 1e-6
        step.append({**made.streamed(0.0, 5), "time_s": stamps, "gyro_v": stamps + 1.0})
        _say(repr(float(stamps[-1])))
        time.sleep(period_s)


def write_fast(folder: Path, steps: int) -> None:
    writer = CampaignWriter(folder, made.meta(status="running"))
    for index in range(1, steps + 1):
        writer.event("begin", step=index)
        _write_step(writer, index)
        _say(str(index))
    writer.finish("complete")
    _say("finished")


def write_told(folder: Path, steps: int) -> None:
    writer = CampaignWriter(folder, made.meta(status="running"))
    for index in range(1, steps + 1):
        writer.step_over(_write_step(writer, index))
        _say(str(index))
    time.sleep(3600.0)


def write_points(folder: Path, burst: int) -> None:
    step = CampaignWriter(folder, made.meta(status="running")).begin_step(made.info(1), made.STREAMED)
    for number in itertools.count(1):
        stamp = time.monotonic()
        step.append_point({"time_s": stamp, "encoder_deg": 90.0, "gyro_v": float(number), "gyro_temp_c": 20.0})
        if number == 1 or (burst and number % burst == 0):
            _say(repr(stamp))
        if number % (burst or 10) == 0:
            time.sleep(1.0 if burst else 0.001)


def _write_step(writer: CampaignWriter, index: int) -> StepInfo:
    whole = made.step(index)
    step = writer.begin_step(whole.info, (*made.STREAMED, *made.POLLED))
    step.append(whole.channels)
    step.flush()
    return step.close(whole.info)


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    where, how, much = sys.argv[1:]
    if how == "slowly":
        write_slowly(Path(where), float(much))
    elif how == "fast":
        write_fast(Path(where), int(much))
    elif how == "told":
        write_told(Path(where), int(much))
    else:
        write_points(Path(where), int(much))
