"""The procedures that a lab has released, checked and started as at the command line, by processes of their own.

The checks are `benchctl check`, the runs `benchctl run`: nothing starts here that the command line refuses. A run
outlives the process that started it; what it prints goes to `NAME.log`, beside its campaign's folder.
"""

from __future__ import annotations

import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.app.run import new_folder, questions_asked
from benchctl.bench import load_bench
from benchctl.campaign.again import parameter_text
from benchctl.campaign.check import bench_time_s, problems
from benchctl.documents import json_document
from benchctl.own_process import own_process
from benchctl.plan.find import find_procedure
from benchctl.recordings.schema import JOURNAL
from benchctl_instruments.errors import UsageError

_CHECKED_WITHIN_S = 60.0
_BEGUN_WITHIN_S = 60.0
"""Wall time that silent instruments may take to be given up."""


class NotStartedError(UsageError):
    """The run was refused, or another one is on the bench; nothing has moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleasedProcedure:
    """A released procedure as the lab names it; `command` are its arguments for `check` and `run`."""

    name: str
    title: str
    says: str
    steps: int
    bench_time_s: float | None
    questions: int
    command: tuple[str, ...]


class Station:
    """A bench whose released procedures can be started into the folder `root`, one at a time; not thread-safe.

    Raises `UsageError` if the bench cannot be read, releases nothing or what cannot be planned, or is turned by hand.
    """

    def __init__(self, bench_toml: Path, root: Path) -> None:
        self._file, self._root = bench_toml.resolve(), root.resolve()
        self.bench = load_bench(str(self._file))
        if not self.bench.released:
            raise UsageError(f"{bench_toml}: releases no procedure; add [released.NAME] with procedure = …")
        if self.bench.by_hand:
            raise UsageError(
                f"{bench_toml}: its table is turned by hand; its runs begin at a terminal, beside the table"
            )
        self.procedures = {name: self._released(name) for name in self.bench.released}
        self._run: subprocess.Popen[bytes] | None = None
        self._campaign = self._root

    def _released(self, name: str) -> ReleasedProcedure:
        released = self.bench.released[name]
        is_file = released.procedure.endswith(".py")
        place = str(self._file.parent / released.procedure) if is_file else released.procedure
        texts = {key: parameter_text(value) for key, value in released.parameters.items()}
        try:
            procedure = find_procedure(place)
            plan = procedure.expand(texts)
        except UsageError as err:
            raise UsageError(f"{self._file}: released.{name}: {err}") from err
        playable = not problems(plan, self.bench)
        return ReleasedProcedure(
            name=name,
            title=released.title or name,
            says=procedure.says,
            steps=len(plan.steps),
            bench_time_s=bench_time_s(plan, self.bench) if playable else None,
            questions=len(questions_asked(plan, self.bench)),
            command=(place, *(f"--parameter={key}={text}" for key, text in texts.items())),
        )

    def check(self, name: str, serial: str) -> dict[str, Any]:
        """Return the result of `benchctl check` with its instruments; `ok` is false where it refuses, for `error`.

        Raises `NotStartedError` if it gives no answer.
        """
        arguments = ["check", *self._command(name, serial), "--out", str(self._root), "--json", "-"]
        checking = own_process("benchctl", arguments, stderr=subprocess.DEVNULL)
        try:
            printed = checking.communicate(timeout=_CHECKED_WITHIN_S)[0]
        except subprocess.TimeoutExpired as err:
            checking.terminate()
            checking.communicate()
            raise NotStartedError(
                f"benchctl check has no answer after {_CHECKED_WITHIN_S:g} s; look at the bench"
            ) from err
        found = json_document(printed, "the answer of benchctl check")
        return dict(found)

    def start(self, name: str, serial: str, who: str) -> Path:
        """Start a released procedure on a unit for a person; return its campaign's folder once it has begun.

        Raises
        ------
        NotStartedError
            The run refuses, as `benchctl run` does, a run started here is still on the bench, or it has not begun in
            time.
        """
        if self._run is not None and self._run.poll() is None:
            raise NotStartedError(f"{self._campaign.name} is on this bench; wait until it is over, or stop it")
        command = self._command(name, serial)
        folder = new_folder(name, serial, self._root)
        log = folder.with_name(f"{folder.name}.log")
        with log.open("xb") as out:
            arguments = ["run", *command, f"--page={who}", "--out", str(folder)]
            run = own_process("benchctl", arguments, stdout=out, stderr=subprocess.STDOUT)
        if run.stdin is not None:
            run.stdin.close()
        self._run, self._campaign = run, folder
        ends_s = time.monotonic() + _BEGUN_WITHIN_S
        while not (folder / JOURNAL).exists():
            if run.poll() is not None:
                raise NotStartedError(_last_line(log))
            if time.monotonic() > ends_s:
                raise NotStartedError(
                    f"{folder.name} has not begun after {_BEGUN_WITHIN_S:g} s; the list of campaigns will show it if "
                    "its instruments answer"
                )
            time.sleep(0.1)
        return folder

    def _command(self, name: str, serial: str) -> tuple[str, ...]:
        return (*self.procedures[name].command, "--bench", str(self._file), f"--unit={serial}")


def _last_line(log: Path) -> str:
    """Return why a run was refused, and remove its log, which has nothing else."""
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines() or ["it ended without a word"]
    with suppress(OSError):
        log.unlink()
    return lines[-1].removeprefix("benchctl: ")
