"""`benchctl run --again`: what is run again, and what is said of it beside the first run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import typer

from benchctl.app.rerun import FirstRun, first_run, lines, rerun_of
from benchctl.bench import Bench
from benchctl.campaign.again import CHOSEN_HERE, bench_again, plan_again
from benchctl.campaign.runner import Outcome
from benchctl.cli.output import Result
from benchctl.plan import Plan
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import refuse_changed


@dataclass(frozen=True, slots=True, kw_only=True)
class Again:
    """The first run, measured, and the plan and bench to run it again; `seeded`: with a seed that was named."""

    first: FirstRun
    plan: Plan
    bench: Bench
    seeded: bool

    def tell(self, outcome: Outcome, result: Result) -> None:
        """Hold a finished run against the first one; raises `typer.Exit` where limits judge it and it is no PASS."""
        rerun = rerun_of(self.first, outcome.recording, expected=() if self.seeded else CHOSEN_HERE)
        result.values["again"] = rerun.values()
        result.say(lines(rerun))
        if rerun.accepted is not None:
            written = rerun.accepted.write(outcome.campaign, "en")
            result.values |= {"verdict": rerun.accepted.acceptance.verdict, **written}
            result.say("\n".join(f"{kind}: {path}" for kind, path in written.items()))
        result.values["rerun"] = rerun.write(outcome.campaign)
        result.say(f"rerun: {result.values['rerun']}")
        if rerun.accepted is not None and rerun.accepted.fails:
            result.ok, result.error = False, rerun.accepted.fails
            raise typer.Exit(1)


def to_run_again(path: Path, *, bench: Bench | None, limits: Path | None, seed: int | None) -> Again:
    """What a recording says is to be run again, on its own bench or on the one that is named.

    Raises
    ------
    UsageError
        Where it was changed, cannot be read, or cannot be run again; nothing has been run then.
    """
    refuse_changed(path, "run again")
    with open_recording(path) as recording:
        meta = recording.meta
    plan = plan_again(meta, str(path))
    stands = bench_again(meta, str(path), bench, seed)
    return Again(first=first_run(path, limits), plan=plan, bench=stands, seeded=seed is not None)
