"""Run, resume and simulate complete campaigns, from a plan and a bench description to a sealed folder."""

from __future__ import annotations

import datetime
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path

from benchctl.app.notify import messages_about
from benchctl.atomic import refuse_existing, refuse_folder
from benchctl.bench import Bench, load_bench
from benchctl.campaign.check import expiring, refuse_problems
from benchctl.campaign.guard.keeper import guarded
from benchctl.campaign.opened import OpenBench, open_bench
from benchctl.campaign.operator import AnswerFile, Answers, Question, questions
from benchctl.campaign.page_operator import PageOperator, forget_question
from benchctl.campaign.resume import Past, past_of, steps_to_play, whole_steps
from benchctl.campaign.runner import AbortedError, Outcome, Progress, no_progress, run_campaign
from benchctl.campaign.safety import SafeState
from benchctl.campaign.stop import forget_stale_stop, forget_stop, heed_file, stop_on_signals
from benchctl.model_file import read_model
from benchctl.plan import Plan
from benchctl.recordings.campaign_manifest import write_manifest
from benchctl.recordings.journal import append_event
from benchctl.recordings.recover import recover
from benchctl.recordings.schema import JOURNAL, RECORDING
from benchctl_instruments.errors import UsageError
from benchctl_instruments.rate_tables.manual import WARNING

_UNWATCHED: AbstractContextManager[Progress] = nullcontext(no_progress)


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """How a run is followed.

    `warn` receives, before the run, the certificates that expire too early and recipients of messages that cannot be
    used, and, at the end, a failure to write the folder's manifest and messages that were not delivered. `progress` is
    entered once the bench is open. `deaf_after` is as in `stop_on_signals`.
    """

    warn: Callable[[str], None]
    progress: AbstractContextManager[Progress] = _UNWATCHED
    deaf_after: bool = False


def bench_of(bench: Bench | str | PathLike[str], seed: int | None, unit: str | None = None) -> Bench:
    """Return a bench, given by itself or as for `load_bench`, with a seed of its noise and errors, if it is simulated.

    `unit` is the serial number of the unit on it, if it is another than the bench states.

    Raises
    ------
    UsageError
        If it cannot be read, if there is a seed and the bench is real or the seed is negative, or the unit is empty.
    """
    loaded = bench if isinstance(bench, Bench) else load_bench(fspath(bench))
    if seed is not None and seed < 0:
        raise UsageError(f"seed = {seed}: expected 0 or more")
    if seed is not None and not loaded.simulated:
        raise UsageError(
            f"seed = {seed}: only a bench with simulated = true has a seed, and {loaded.name} is none; leave it out"
        )
    if unit is not None and not unit.strip():
        raise UsageError("unit: expected a serial number, got an empty text")
    return loaded.with_seed(seed).with_unit(unit)


def play(
    plan: Plan,
    bench: Bench,
    folder: Path,
    *,
    watch: Watch,
    wires: bool = True,
    past: Past | None = None,
    answers: Answers | None = None,
    page: str | None = None,
) -> Outcome:
    """Run a plan on a bench, or resume the campaign `past`, obeying signals and the live page.

    The folder's manifest is written once everything is closed. `answers` replace an operator's answers; `page` is who
    starts the run at the live page, where its questions are answered. `wires` is as in `open_bench`; without them no
    messages are sent.

    Raises
    ------
    UsageError
        Before anything moves, as in `run_campaign`.
    BenchNotReadyError
        Lists every instrument that did not answer, and why.
    """
    refuse_problems(plan, bench, folder)
    if answers is not None:
        answers.refuse_unanswered(questions_asked(plan, bench, past))
    if page is not None:
        if bench.by_hand:
            raise UsageError(f"{bench.name}: its table is turned by hand; run it at a terminal, beside the table")
        bench = bench.model_copy(update={"operator": page})
    for certificate in expiring(plan, bench, past.first if past else 1):
        watch.warn(certificate.message)
    if bench.by_hand:
        watch.warn(WARNING)
    elapsed_s = past.elapsed_s if past else 0.0
    if past is not None:
        forget_stale_stop(folder)
        forget_question(folder)
    with messages_about(plan, bench if wires else bench.silent(), folder, watch.warn) as messenger:
        with (
            stop_on_signals(deaf_after=watch.deaf_after) as stop,
            guarded(bench, folder / JOURNAL) as guard,
            open_bench(bench, wires=wires, elapsed_s=elapsed_s, purpose=f"campaign {folder.absolute()}") as opened,
            watch.progress as progress,
        ):
            heed_file(stop, folder)
            then = opened.operator if bench.simulated else None
            if answers is not None:
                opened = replace(opened, operator=AnswerFile(answers, bench.unit.serial, then))
            if page is not None:
                opened = replace(opened, operator=PageOperator(folder, page, bench.unit.serial, then))
            outcome = run_campaign(
                plan, opened, folder, stop=stop, progress=progress, listener=messenger.hear, guard=guard, past=past
            )
        forget_stop(folder)
        try:
            for message in messenger.end(outcome):
                with suppress(UsageError):  # a disk error hides no other error
                    append_event(folder / JOURNAL, "notify", {"says": message})
        finally:  # Ctrl-C may end the wait for a mail server
            _seal(outcome, watch.warn)
    return outcome


def play_on(plan: Plan, opened: OpenBench, folder: Path, *, warn: Callable[[str], None]) -> Outcome:
    """Run a plan on a bench that is open already and may have run others; the recording begins at the present time.

    `warn` is as in `Watch`. Raises as `run_campaign` does.
    """
    now_s = opened.clock.now()
    from_now = replace(opened, epoch_s=now_s, elapsed_s=opened.elapsed_s + opened.epoch_s - now_s)
    outcome = run_campaign(plan, from_now, folder)
    _seal(outcome, warn)
    return outcome


def resume(
    plan: Plan,
    bench: Bench,
    folder: Path,
    *,
    watch: Watch,
    seeded: bool = False,
    wires: bool = True,
    answers: Answers | None = None,
    page: str | None = None,
    confirm: Callable[[Past], None] | None = None,
) -> Outcome:
    """Resume a campaign. If all its steps are complete, only close it; nothing moves.

    `seeded` is as in `past_of`, `wires`, `answers` and `page` are as in `play`. `confirm` is called before a real
    bench moves, and raises an exception if it shall not.

    Raises
    ------
    UsageError
        If it is not the same campaign, or as in `play`.
    """
    with past_of(folder, plan, bench, seeded=seeded) as past:
        if past.is_whole:
            past.lock.release()
            return _closed(past)
        if confirm is not None and not bench.simulated:
            confirm(past)
        return play(plan, past.bench, folder, watch=watch, wires=wires, past=past, answers=answers, page=page)


def _closed(past: Past) -> Outcome:
    """Close a campaign whose steps are all complete, and return its outcome."""
    began_s = time.monotonic()
    closed = recover(past.folder)
    complete = len(whole_steps(past.plan, closed.steps))
    return Outcome(
        campaign=past.folder,
        recording=closed.recording,
        status=closed.status,
        planned=len(past.plan.steps),
        whole=complete,
        samples=sum(info.samples for info in closed.steps),
        bench_time_s=past.elapsed_s,
        wall_time_s=time.monotonic() - began_s,
        safe=SafeState(rate_dps=None, chamber_setpoint_c=None, problems=()),
        error=None if closed.status == "complete" else AbortedError(f"{closed.reason}; resume it again"),
    )


def simulate(
    plan: Plan, bench: Bench, output: Path, *, watch: Watch, model: Path | None = None, seed: int | None = None
) -> Outcome:
    """Run a plan on a simulated bench, without the instrument protocols, and keep only the recording, as `output`.

    The bench follows the file `model`, if given, and has the noise of `seed`.

    Raises
    ------
    UsageError
        If the bench is real, the model or the seed cannot be used, or `output` exists or has no folder; as in `play`.
    BenchError
        What ended the run early; nothing is kept then.
    """
    if not bench.simulated:
        raise UsageError(f"--bench {bench.name}: expected a bench with simulated = true; benchctl run takes real ones")
    bench = bench_of(bench if model is None else bench.obeying(read_model(model)), seed)
    refuse_existing(output)
    refuse_folder(output)
    if not output.parent.is_dir():
        raise UsageError(f"-o {output}: there is no folder {output.parent}; make it first")
    with tempfile.TemporaryDirectory(prefix=f".{output.name}.", dir=output.parent) as folder:
        outcome = play(plan, bench, Path(folder), watch=watch, wires=False)
        if outcome.error is not None:
            raise outcome.error  # without the note of `raise_error`: the recording is not kept
        shutil.move(outcome.recording, output)
    return replace(outcome, campaign=output.parent, recording=output)


def questions_asked(plan: Plan, bench: Bench, past: Past | None = None) -> list[Question]:
    """Return the questions to an operator, in their order, when a plan is run or resumed."""
    to_play = steps_to_play(plan, past.infos if past else (), bench.safe.chamber_c)
    may_be_off = past is not None and past.may_be_off
    steps = ((number, step) for _, number, step in to_play)
    return list(questions(steps, bench.unit.serial, may_be_off=may_be_off, by_hand=bench.by_hand))


def new_folder(procedure: str, serial: str, place: Path = Path("results")) -> Path:
    """Return a path in a place that does not exist yet, named by time, procedure and unit."""
    stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    return free_folder(place, re.sub(r"[^A-Za-z0-9._+-]+", "-", f"{stamp}_{procedure}_{serial}"))


def free_folder(place: Path, name: str) -> Path:
    """Return a path in a place that does not exist yet: the name, with a number if needed."""
    folder, number = place / name, 1
    while folder.exists():
        number += 1
        folder = place / f"{name}_{number}"
    return folder


def _seal(outcome: Outcome, warn: Callable[[str], None]) -> None:
    """Write the manifest of a campaign that has its recording; a disk error only warns and hides no other error."""
    if outcome.recording.name != RECORDING:
        return
    try:
        write_manifest(outcome.campaign)
    except UsageError as err:
        warn(f"the campaign has no manifest: {err}")
