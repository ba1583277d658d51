"""Write the next experiment of a diagnosis to a file for `benchctl run`, or run it on the simulated bench."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchctl.app.run import new_folder, play
from benchctl.cli.campaigns import at_terminal
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
    """Return the named bench, or the bench of the first recording if `named` is None, with new noise.

    Raises `UsageError` if it is not simulated: on hardware, an experiment is started with `benchctl run`.
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
    """Run the experiment and return the path of its recording; raise the error that ended it early, if any."""
    plan = _plan(following)
    folder = new_folder(plan.procedure, bench.unit.serial)
    outcome = play(plan, bench, folder, watch=at_terminal(quiet), wires=False)
    outcome.raise_error()
    return outcome.recording


def preview_next(following: NextExperiment, bench: Bench, result: Result) -> None:
    """Preview the experiment without running it; store the values under `dry_run`."""
    plan, preview = _plan(following), Result(result.quiet)
    result.values["dry_run"] = preview.values
    preview_run(preview, plan, bench, new_folder(plan.procedure, bench.unit.serial), answers=None)


def refuse_other_files(path: Path) -> None:
    """Raise `UsageError` unless the path is that of a Python file."""
    if path.suffix != ".py":
        raise UsageError(f"--next {path}: a procedure's file ends in .py; name it so")


def write_next(path: Path, diagnosis: Diagnosis) -> str:
    """Write the experiment as a procedure file; return one line that states how to run it."""
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
        raise UsageError(f"--settle: {path} was not made by a simulated bench; name a simulated one with --bench")
    return recorded_bench(meta, str(path))
