"""Run a complete campaign, from a plan and a bench description to a sealed folder; used by the commands and the API."""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from benchctl.bench import Bench
from benchctl.campaign.check import expiring, refuse_problems
from benchctl.campaign.guard.keeper import guarded
from benchctl.campaign.hands import AnsweringHands, Answers, Question, questions
from benchctl.campaign.opened import open_bench
from benchctl.campaign.resume import Past, steps_to_play
from benchctl.campaign.runner import Outcome, Progress, nobody, run_campaign
from benchctl.campaign.stop import forget_stale_stop, forget_stop, heed_file, stop_on_signals
from benchctl.plan import Plan
from benchctl.recordings.campaign_manifest import write_manifest
from benchctl.recordings.schema import JOURNAL, RECORDING
from benchctl_instruments.errors import UsageError

_UNWATCHED: AbstractContextManager[Progress] = nullcontext(nobody)


def play(
    plan: Plan,
    bench: Bench,
    folder: Path,
    *,
    warn: Callable[[str], None],
    progress: AbstractContextManager[Progress] = _UNWATCHED,
    wires: bool = True,
    past: Past | None = None,
    answers: Answers | None = None,
    deaf_after: bool = False,
) -> Outcome:
    """Run a plan on a bench, or resume the campaign `past`, obeying signals and the live page.

    `warn` receives, before the run, the certificates that expire too early, and, at the end, a failure to write the
    folder's manifest, which is written once everything is closed. `progress` is entered once the bench is open.
    `answers` replace an operator's answers. `wires` is as in `open_bench`, `deaf_after` as in `stop_on_signals`.

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
    for certificate in expiring(plan, bench, past.first if past else 1):
        warn(certificate.says)
    elapsed_s = past.elapsed_s if past else 0.0
    if past is not None:
        forget_stale_stop(folder)
    with (
        stop_on_signals(deaf_after=deaf_after) as stop,
        guarded(bench, folder / JOURNAL) as guard,
        open_bench(bench, wires=wires, elapsed_s=elapsed_s, purpose=f"campaign {folder.absolute()}") as opened,
        progress as watched,
    ):
        heed_file(stop, folder)
        if answers is not None:
            then = opened.hands if bench.simulated else None
            opened = replace(opened, hands=AnsweringHands(answers, bench.unit.serial, then))
        outcome = run_campaign(plan, opened, folder, stop=stop, progress=watched, guard=guard, past=past)
    forget_stop(folder)
    seal(outcome, warn)
    return outcome


def questions_asked(plan: Plan, bench: Bench, past: Past | None = None) -> list[Question]:
    """Return the questions to an operator, in their order, when a plan is run or resumed."""
    to_play = steps_to_play(plan, past.infos if past else (), bench.safe.chamber_c)
    may_be_off = past is not None and past.may_be_off
    return list(questions(((number, step) for _, number, step in to_play), bench.unit.serial, may_be_off=may_be_off))


def new_folder(procedure: str, serial: str) -> Path:
    """Return a path in results/ that does not exist yet, named by time, procedure and unit."""
    stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    name = re.sub(r"[^A-Za-z0-9._+-]+", "-", f"{stamp}_{procedure}_{serial}")
    folder, count = Path("results") / name, 1
    while folder.exists():
        count += 1
        folder = Path("results") / f"{name}_{count}"
    return folder


def seal(outcome: Outcome, warn: Callable[[str], None]) -> None:
    """Write the manifest of a campaign that has its recording; a disk error only warns and hides no other error."""
    if outcome.recording.name != RECORDING:
        return
    try:
        write_manifest(outcome.campaign)
    except UsageError as err:
        warn(f"the campaign has no manifest: {err}")
