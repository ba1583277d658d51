"""`benchctl run --again`: prepare a rerun, and compare it with the first run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchctl.app.notify import send_result
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
    """The first run with its measured results, and the plan and bench of the rerun.

    `seeded` is true if a seed was given on the command line.
    """

    first: FirstRun
    plan: Plan
    bench: Bench
    seeded: bool

    def tell(self, outcome: Outcome, result: Result, warn: Callable[[str], None]) -> None:
        """Compare a finished run with the first one; raise `typer.Exit` if it is judged by limits and is not PASS.

        The verdict is also sent as a message; `warn` is as in `send_result`.
        """
        rerun = rerun_of(self.first, outcome.recording, expected=() if self.seeded else CHOSEN_HERE)
        result.values["again"] = rerun.values()
        result.say(lines(rerun))
        if rerun.accepted is not None:
            files = rerun.accepted.write(outcome.campaign).files
            result.values |= {"verdict": rerun.accepted.verdict, **files}
            result.say_files(files)
        result.values["rerun"] = rerun.write(outcome.campaign)
        result.say(f"rerun: {result.values['rerun']}")
        if rerun.accepted is not None:
            verdict = ": ".join(filter(None, (rerun.accepted.verdict, rerun.accepted.fails)))
            send_result(self.plan, self.bench, outcome.campaign, verdict, warn)
        if rerun.accepted is not None and rerun.accepted.fails:
            result.fail(rerun.accepted.fails)


def to_run_again(path: Path, *, bench: Bench | None, limits: Path | None, seed: int | None) -> Again:
    """Return the plan and bench to rerun a recording, on its recorded bench or on `bench`.

    Raises
    ------
    UsageError
        If the recording was changed, cannot be read, or cannot be rerun. Nothing has moved then.
    """
    refuse_changed(path, "run again")
    with open_recording(path) as recording:
        meta = recording.meta
    plan = plan_again(meta, str(path))
    rerun_bench = bench_again(meta, str(path), bench, seed)
    return Again(first=first_run(path, limits), plan=plan, bench=rerun_bench, seeded=seed is not None)
