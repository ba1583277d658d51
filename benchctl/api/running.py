"""Running a plan on a bench, from Python."""

from __future__ import annotations

import warnings
from contextlib import AbstractContextManager, nullcontext
from os import PathLike, fspath
from pathlib import Path

from benchctl.api.planning import plan as plan_of
from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.campaign.playing import new_folder, play
from benchctl.campaign.progress import Progress, nobody
from benchctl.campaign.runner import Outcome
from benchctl.plan import Plan, Procedure
from benchctl_instruments.errors import UsageError


def run(
    plan: Plan | Procedure | str | PathLike[str],
    bench: Bench | str | PathLike[str] = SIMULATED,
    *,
    out: str | PathLike[str] | None = None,
    seed: int | None = None,
    progress: Progress = nobody,
    wires: bool = True,
    check: bool = True,
) -> Outcome:
    """Run a plan on a bench and record it. Whatever ends it, the bench is brought to rest and the recording closed.

    Parameters
    ----------
    plan
        What `api.plan` gave; or what it takes, with the parameters' defaults.
    bench
        A bench.toml, a `Bench`, or "simulated", which needs neither file nor hardware.
    out
        The campaign's folder; by default a new one in results/.
    seed
        Draws the noise and the errors of a simulated bench, 0 or more; by default those that its file states.
    progress
        Called with a `Moment`, several times a second of wall time: step, temperatures in °C, rate in deg/s, time left
        in s of bench time.
    wires
        False takes simulated instruments without their protocols: the same physics, faster.
    check
        Raise what ended the campaign early. Without it the outcome says so: `status`, `error`.

    Raises
    ------
    UsageError
        Before anything moves: the plan goes beyond the bench's limits, the disk has no room, the folder is in use.
    BenchNotReadyError
        Names every instrument that did not answer, and why.
    BenchError
        What ended the campaign early, Ctrl-C included; a note says where its recording is.

    Examples
    --------
    >>> from benchctl import api
    >>> outcome = api.run(api.plan("static", soak_s=60, duration_s=10), out="rest", seed=7)
    >>> outcome.status, outcome.whole, outcome.samples
    ('complete', 2, 5000)
    """
    stands = bench if isinstance(bench, Bench) else load_bench(fspath(bench))
    if seed is not None and (seed < 0 or not stands.simulated):
        raise UsageError(f"seed = {seed}: expected 0 or more, and a bench with simulated = true; this is {stands.name}")
    planned = plan if isinstance(plan, Plan) else plan_of(plan)
    folder = new_folder(planned.procedure, stands.unit.serial) if out is None else Path(out)
    told: AbstractContextManager[Progress] = nullcontext(progress)
    outcome = play(planned, stands.with_seed(seed), folder, warn=_warn, progress=told, wires=wires)
    if check and outcome.error is not None:
        outcome.error.add_note(f"the recording of what was done: {outcome.recording}")
        raise outcome.error
    return outcome


def _warn(says: str) -> None:
    warnings.warn(says, stacklevel=4)  # whoever called `run`
