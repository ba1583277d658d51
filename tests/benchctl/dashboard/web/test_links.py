"""Symbolic links and HDF5's own links in a served folder: nothing outside it is opened, whatever is asked for."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import httpx
import pytest
from websockets.exceptions import ConnectionClosedError

from benchctl.recordings.campaign_folder import CampaignWriter
from tests.benchctl.dashboard.web.conftest import write_campaign
from tests.benchctl.dashboard.web.serving import Served, serving
from tests.benchctl.history import made_history
from tests.benchctl.recordings import made, open_folder

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="watches opened files with inotify")

SECRET = "root:x:0:0:secret"
_IN_ACCESS, _IN_OPEN = 0x1, 0x20
KINDS = ("calibration", "diagnosis", "acceptance")


class Watch:
    """Reports which files of some folders were opened or read by any process, as inotify has it."""

    def __init__(self, root: Path) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = self._libc.inotify_init1(os.O_NONBLOCK)
        self._places: dict[int, Path] = {}
        for place in [root, *(path for path in root.rglob("*") if path.is_dir())]:
            number = self._libc.inotify_add_watch(self._descriptor, os.fsencode(place), _IN_ACCESS | _IN_OPEN)
            assert number >= 0, os.strerror(ctypes.get_errno())
            self._places[number] = place

    def opened(self) -> set[str]:
        """The names of what was opened or read since the last call."""
        found, content = set(), b""
        try:
            while more := os.read(self._descriptor, 1 << 16):
                content += more
        except BlockingIOError:
            pass
        while content:
            number, _, _, length = struct.unpack_from("iIII", content)
            name = content[16 : 16 + length].rstrip(b"\0").decode()
            found.add(str(self._places[number] / name))
            content = content[16 + length :]
        return found

    def close(self) -> None:
        os.close(self._descriptor)


@contextmanager
def watched(folder: Path) -> Iterator[Watch]:
    watch = Watch(folder)
    try:
        (folder / "secret.txt").read_text()
        assert watch.opened() == {str(folder / "secret.txt")}  # it sees what is opened
        yield watch
    finally:
        watch.close()


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder beside the served one, with all that a link could lead to; each file holds the secret."""
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "secret.txt").write_text(SECRET)
    digest = made_history.recorded(folder / "recording.h5", SECRET)
    finished = write_campaign(folder / "finished")
    finished.event("note", says=SECRET)
    finished.finish("complete")
    begun = write_campaign(folder / "begun")
    begin_step(begun)
    begun.event("note", says=SECRET)
    begun.release()
    (folder / "acceptance.json").write_text(made_history.accepted([made_history.one_test(SECRET)], digest))
    (folder / "coefficients.json").write_text(made_history.fitted({SECRET: (1.0, 0.1)}))
    (folder / "report.html").write_text(f"<p>{SECRET}")
    open_folder.write_open(folder / "open")
    return folder


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "results"
    folder.mkdir()
    return folder


def begin_step(writer: CampaignWriter) -> None:
    third = made.step(3)
    into = writer.begin_step(third.info, tuple(third.channels))
    into.append(third.channels)
    into.flush()


def ask_everything(served: Served) -> tuple[dict[str, str], list[httpx.Response]]:
    """Ask every route of every campaign; the status of each campaign by its name, and all answers."""
    answers = []
    with served.client(served.view_token) as client:

        def ask(path: str) -> httpx.Response:
            answers.append(client.get(path))
            return answers[-1]

        listed = ask("/api/campaigns").json()["campaigns"]
        for campaign in listed:
            place = f"/api/campaigns/{campaign['id']}"
            ask(place)
            ask(f"{place}/events")
            for channel in ("gyro_v", "rate_dps", "angle_deg", "encoder_deg", "air_c"):
                ask(f"{place}/series?channel={channel}&from_s=0&to_s=1000&pixels=100")
            for kind in KINDS:
                ask(f"{place}/documents/{kind}")
                ask(f"{place}/documents/{kind}/report")
            with served.watch(campaign["id"]) as live, suppress(ConnectionClosedError):
                live.send(json.dumps({"watch": {"channels": ["gyro_v"], "window_s": 600, "pixels": 100}}))
                answers.append(httpx.Response(200, text=str(live.recv(timeout=20))))
        ask("/api/history")
        ask("/api/explain/bias")
        ask("/api/explain/..%2F..%2Foutside%2Fsecret.txt")
        ask("/page/..%2F..%2F..%2F..%2Foutside%2Fsecret.txt")
        ask("/")
    with served.client() as client:
        for campaign in listed:
            said = client.post(f"/api/campaigns/{campaign['id']}/stop", json={"confirm": campaign["name"]})
            answers.append(said)
    return {campaign["name"]: campaign["status"] for campaign in listed}, answers


def finished(place: Path) -> Path:
    write_campaign(place).finish("complete")
    return place


def unfinished(place: Path) -> Path:
    writer = write_campaign(place)
    begin_step(writer)
    writer.release()
    return place


def replace(path: Path, target: Path | str) -> None:
    """Put a link in the place of a file or a folder."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(exist_ok=True)
    path.symlink_to(target)


def _documents(root: Path, outside: Path) -> None:
    place = finished(root / "documents")
    for name in ("report.html", "diagnosis.html", "acceptance.html"):
        replace(place / name, outside / "secret.txt")
    for name in ("acceptance.json", "coefficients.json"):
        replace(place / name, outside / name)


def _relative(root: Path, outside: Path) -> None:
    replace(finished(root / "relative") / "report.html", "../../../outside/secret.txt")


def _chain(root: Path, outside: Path) -> None:
    place = finished(root / "chain")
    replace(place / "second", outside / "report.html")
    replace(place / "first", "second")
    replace(place / "report.html", "first")


def _folders_of_documents(root: Path, outside: Path) -> None:
    shutil.copy(finished(root / "a") / "recording.h5", root / "made.h5")
    for kind in KINDS:
        replace(root / f"made.{kind}", outside)
    replace(root / "report.html", outside / "report.html")


def _whole_folders(root: Path, outside: Path) -> None:
    replace(root / "finished", outside / "finished")
    replace(root / "begun", "../../outside/begun")
    replace(root / "everything", outside)


def _recordings(root: Path, outside: Path) -> None:
    replace(finished(root / "recording") / "recording.h5", outside / "recording.h5")
    replace(root / "single.h5", outside / "recording.h5")


def _journals(root: Path, outside: Path) -> None:
    replace(finished(root / "over") / "journal.jsonl", outside / "begun" / "journal.jsonl")
    replace(unfinished(root / "died") / "journal.jsonl", outside / "begun" / "journal.jsonl")


def _campaign_files(root: Path, outside: Path) -> None:
    replace(unfinished(root / "described") / "campaign.h5", outside / "begun" / "campaign.h5")
    replace(unfinished(root / "locked") / "running.lock", outside / "secret.txt")


def _steps(root: Path, outside: Path) -> None:
    replace(unfinished(root / "folder") / "steps", outside / "begun" / "steps")
    for number, name in enumerate(sorted(path.name for path in (outside / "begun" / "steps").iterdir())):
        replace(unfinished(root / f"step_{number}") / "steps" / name, outside / "begun" / "steps" / name)


def _open_recordings(root: Path, outside: Path) -> None:
    for name in ("recording.json", "samples.csv.gz"):
        place = open_folder.write_open(root / f"open_{name}")
        replace(place / name, outside / "open" / name)


def _hdf5(root: Path, outside: Path) -> None:
    def changed(name: str, change: Callable[[h5py.File, h5py.Group], None]) -> None:
        place = finished(root / name)
        with h5py.File(place / "recording.h5", "r+") as file:
            change(file, file["steps/0001"])

    def instead(name: str, put: Callable[[h5py.Group, str], object]) -> None:
        def change(file: h5py.File, step: h5py.Group) -> None:
            for channel in ("gyro_v", "encoder_deg"):
                del step[channel]
                put(step, channel)

        changed(name, change)

    def steps_elsewhere(file: h5py.File, step: h5py.Group) -> None:
        del file["steps"]
        file["steps"] = h5py.ExternalLink(outside / "recording.h5", "/steps")

    def step_elsewhere(file: h5py.File, step: h5py.Group) -> None:
        del file["steps/0001"]
        file["steps/0001"] = h5py.ExternalLink(outside / "recording.h5", "/steps/0001")

    def virtual(*, unlimited: bool) -> Callable[[h5py.Group, str], object]:
        def put(step: h5py.Group, channel: str) -> object:
            most = (None,) if unlimited else (20,)
            source = h5py.VirtualSource(
                outside / "recording.h5", f"/steps/0001/{channel}", shape=(20,), dtype="<f8", maxshape=most
            )
            layout = h5py.VirtualLayout(shape=(20,), dtype="<f8", maxshape=most)
            layout[: h5py.h5s.UNLIMITED if unlimited else 20] = source[: h5py.h5s.UNLIMITED if unlimited else 20]
            return step.create_virtual_dataset(channel, layout)

        return put

    changed("steps_by_link", steps_elsewhere)
    changed("step_by_link", step_elsewhere)
    instead(
        "channel_by_link",
        lambda step, name: step.__setitem__(name, h5py.ExternalLink(outside / "recording.h5", f"/steps/0001/{name}")),
    )
    instead("virtual", virtual(unlimited=False))
    instead("virtual_growing", virtual(unlimited=True))
    instead(
        "external_storage",
        lambda step, name: step.create_dataset(
            name, (8,), "<f8", external=[(str(outside / "secret.txt"), 0, h5py.h5f.UNLIMITED)]
        ),
    )


PLANTS: tuple[Callable[[Path, Path], None], ...] = (
    _documents,
    _relative,
    _chain,
    _folders_of_documents,
    _whole_folders,
    _recordings,
    _journals,
    _campaign_files,
    _steps,
    _open_recordings,
    _hdf5,
)


def test_nothing_outside_the_served_folder_is_opened(root: Path, outside: Path, tmp_path: Path) -> None:
    finished(root / "sound")
    for plant in PLANTS:
        (root / plant.__name__).mkdir()
        plant(root / plant.__name__, outside)
    with serving(root, tmp_path / "cache") as served, watched(outside) as watch:
        statuses, answers = ask_everything(served)
        assert watch.opened() == set()
    assert statuses["sound"] == "complete"
    assert not [answer.text for answer in answers if "secret" in answer.text]
    assert not [answer for answer in answers if answer.status_code == 500]


def test_a_link_is_named_where_it_stands_in_the_place_of_a_file(root: Path, outside: Path, tmp_path: Path) -> None:
    _documents(root, outside)
    _recordings(root, outside)
    _campaign_files(root, outside)
    with serving(root, tmp_path / "cache") as served, served.client(served.view_token) as client:
        report = client.get(f"/api/campaigns/{served.key_of('documents')}/documents/calibration/report")
        listed = {one["name"]: one for one in client.get("/api/campaigns").json()["campaigns"]}
    assert report.status_code == 422
    assert "report.html: cannot be read: it is, or lies behind, a symbolic link" in report.json()["error"]
    assert listed["described"]["status"] == "unreadable"
    assert "symbolic link" in listed["described"]["says"]


@pytest.mark.parametrize("swapped", ["report.html", "."])
def test_a_link_that_is_swapped_in_while_it_is_opened_is_not_followed(
    root: Path, outside: Path, tmp_path: Path, swapped: str
) -> None:
    place = finished(root / "swapped")
    (place / "report.html").write_text("<p>ours")
    (tmp_path / "link").symlink_to(outside / "report.html" if swapped == "report.html" else outside / "finished")
    over = threading.Event()

    def swap() -> None:
        """Put the link and the file in each other's place, again and again, each time in one move."""
        libc = ctypes.CDLL(None, use_errno=True)
        one, other = os.fsencode(place / swapped), os.fsencode(tmp_path / "link")
        while not over.is_set():
            assert libc.renameat2(-100, one, -100, other, 2) == 0, os.strerror(ctypes.get_errno())

    with serving(root, tmp_path / "cache") as served, watched(outside) as watch, served.client() as client:
        report = f"/api/campaigns/{served.key_of('swapped')}/documents/calibration/report"
        swapping = threading.Thread(target=swap)
        swapping.start()
        try:
            answers = [client.get(report) for _ in range(300)]
        finally:
            over.set()
            swapping.join()
        assert watch.opened() == set()
    assert {answer.text for answer in answers if answer.status_code == 200} == {"<p>ours"}
    assert any(answer.status_code in (404, 422) for answer in answers)
