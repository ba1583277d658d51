"""A process that writes a campaign until it is killed: `python -m … FOLDER slowly PERIOD_S` or `… FOLDER fast STEPS`.

Slowly: step 1 is finished, step 2 gets five samples every period, stamped with the monotonic clock that all processes
share; the last stamp is printed once `append` has returned. Fast: as many steps as are asked for, then `finish`; prints
each index once its step is closed, and `finished`.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from benchctl.recordings.campaign_folder import CampaignWriter
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


def _write_step(writer: CampaignWriter, index: int) -> None:
    whole = made.step(index)
    step = writer.begin_step(whole.info, (*made.STREAMED, *made.POLLED))
    step.append(whole.channels)
    step.flush()
    step.close(whole.info)


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    where, how, much = sys.argv[1:]
    write_slowly(Path(where), float(much)) if how == "slowly" else write_fast(Path(where), int(much))
