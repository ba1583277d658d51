"""One server for the tests of a worker: a campaign that is over, and one that somebody is writing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from benchctl.recordings.campaign_folder import CampaignWriter
from tests.benchctl.dashboard.web.serving import Served, serving
from tests.benchctl.recordings.made import meta, step

OVER, RUNNING = "over", "running"


@pytest.fixture(scope="session")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a campaign that is over, and one whose lock this process holds."""
    root = tmp_path_factory.mktemp("campaigns")
    over = write_campaign(root / OVER)
    over.finish("complete")
    running = write_campaign(root / RUNNING)
    third = step(3)
    running.event("step", index=3, name=third.info.name, bench_s=third.info.t_end)
    into = running.begin_step(third.info, tuple(third.channels))
    into.append(third.channels)
    into.flush()
    yield root
    running.release()


@pytest.fixture(scope="session")
def served(campaigns: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server on a port of its own."""
    with serving(campaigns, tmp_path_factory.mktemp("cache")) as server:
        yield server


def write_campaign(folder: Path) -> CampaignWriter:
    """A campaign with two whole steps, still open."""
    writer = CampaignWriter(folder, meta(status="running"))
    writer.event("prepared", planned=3, bench_s=0.0)
    for number in (1, 2):
        made = step(number)
        writer.event("step", index=number, name=made.info.name, bench_s=made.info.t_start)
        into = writer.begin_step(made.info, tuple(made.channels))
        into.append(made.channels)
        writer.step_over(into.close(made.info))
    return writer
