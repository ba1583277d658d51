"""The next experiment of a diagnosis: written down for `benchctl run`, or run at once on the simulated bench."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchctl.campaign.playing import new_folder
from benchctl.cli.campaigns import play
from benchctl.cli.dry_run import preview_run
from benchctl.cli.output import Result
from benchctl.plan import Plan
from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts, plan_source
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    from benchctl.bench import Bench
    from benchctl.diagnosis.result import Diagnosis, NextExperiment


def bench_of(recordings: Sequence[Path], named: str | None) -> Bench:
    """The simulated bench of that name; without one that which the first recording was made on, on another day.

    Raises `UsageError` where it is not a simulated one: on hardware an experiment is started by `benchctl run`.
    """
    from benchctl.bench import load_bench
    from benchctl.campaign.opened import another_day

    bench = _recorded_on(recordings[0]) if named is None else load_bench(named)
    if not bench.simulated:
        raise UsageError(
            f"--settle: {bench.name} is no simulated bench; write the experiment with --next FILE.py, look at it with "
            "benchctl check, and start it with benchctl run"
        )
    return another_day(bench, len(recordings))


def run_next(following: NextExperiment, bench: Bench, *, quiet: bool) -> Path:
    """Run the experiment and return its recording; raises what ended it early."""
    plan = _plan(following)
    outcome = play(plan, bench, new_folder(plan.procedure, bench.unit.serial), quiet=quiet, wires=False)
    if outcome.error is not None:
        raise outcome.error
    return outcome.recording


def preview_next(following: NextExperiment, bench: Bench, result: Result) -> None:
    """Say what running the experiment would do, to programs under `dry_run`; nothing is run."""
    plan, told = _plan(following), Result(result.quiet)
    result.values["dry_run"] = told.values
    preview_run(told, plan, bench, new_folder(plan.procedure, bench.unit.serial), answers=None)


def refuse_other_files(path: Path) -> None:
    """Raise `UsageError` where no procedure could be read from a file of that name."""
    if path.suffix != ".py":
        raise UsageError(f"--next {path}: a procedure's file ends in .py; name it so")


def write_next(path: Path, diagnosis: Diagnosis) -> str:
    """Write the experiment as a procedure's file; what to do with it, in a line."""
    from benchctl.atomic import whole_file

    following = diagnosis.next_experiment
    if not following.procedure:
        return f"nothing is left open: {path} is not written"
    with whole_file(path) as temporary:
        temporary.write_text(plan_source(_plan(following), following.says), encoding="utf-8")
    return f"next experiment: benchctl run {path} --bench bench.toml"


def _plan(following: NextExperiment) -> Plan:
    return find_procedure(following.procedure).expand(as_texts(following.parameters))


def _recorded_on(path: Path) -> Bench:
    from benchctl.campaign.provenance import recorded_bench
    from benchctl.recordings.reader import open_recording

    with open_recording(path) as recording:
        meta = recording.meta
    if not meta.provenance.get("bench_physics"):
        raise UsageError(
            f"--settle: {path} was not made by a simulated bench; name one that stands for it with --bench"
        )
    return recorded_bench(meta, str(path))
