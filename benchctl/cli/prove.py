"""`benchctl prove`: run sealed (blind) trials of the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from benchctl.cli.output import JsonOption, QuietOption, Result, out_option, result_of

if TYPE_CHECKING:
    from benchctl.diagnosis.result import Part

_TRIALS_ON = 20


def prove(
    trials: Annotated[
        int | None,
        typer.Option("--trials", metavar="N", min=1, help="Number of trials; default: 340, divided among the classes."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of the concealed effects.")] = 1,
    only: Annotated[
        list[str] | None, typer.Option("--class", metavar="NAME", help="A class of trials; default: all.")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", min=1, help="Number of trials in parallel.")] = 2,
    generic: Annotated[
        bool | None,
        typer.Option("--generic/--no-generic", help="Also run a sparse regression (pysindy); default: if installed."),
    ] = None,
    out: Annotated[Path | None, out_option("Folder of the trials; default: results/prove_seed….")] = None,
    on: Annotated[
        Path | None,
        typer.Option("--on", metavar="RECORDING", help="Add drawn effects to this real recording."),
    ] = None,
    part: Annotated[str, typer.Option("--part", metavar="PART", help="With --on: gyro, drive or chamber.")] = "gyro",
    keep: Annotated[bool, typer.Option("--keep", help="Keep the recordings, 4 MB each.")] = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Draw concealed effects, run the simulated bench through its wire protocols, diagnose blind, unseal and score.

    The digest of the concealed effects of each trial is printed before the diagnosis. After Ctrl-C, repeat the command
    to continue. Example: `benchctl prove --trials 22 --seed 7`

    With --on, the effects are added to a real recording, and the findings are compared with those of the unchanged
    recording. Example: `benchctl prove --on yaw.h5 --trials 20`
    """
    if on is not None:
        _on_recording(on, part, trials or _TRIALS_ON, seed, jobs, out, only or generic or keep, json_to, quiet)
        return
    from benchctl.campaign.stop import stop_on_signals
    from benchctl.proof.running import ProofSettings, run_proof
    from benchctl.proof.summary import summarize
    from benchctl.reports.proof_page import lines, write_proof_report

    with result_of("prove", json_to, quiet) as result:
        from benchctl.proof.classes import USUAL_TRIALS, class_names

        settings = ProofSettings(
            seed=seed,
            trials=trials or USUAL_TRIALS,
            only=class_names(only or ()),
            generic=_generic(generic, result),
            keep=keep,
            jobs=jobs,
        )
        folder = out or Path("results") / f"prove_seed{seed}"
        with stop_on_signals() as stop, _progress(result, settings.trials, quiet) as on_event:
            finished = list(run_proof(settings, folder, on_status=on_event, stop=stop))
        summary = summarize(seed, finished)
        written = write_proof_report(folder, summary)
        result.values |= {**summary.as_json(), **written, "folder": folder}
        for line in lines(summary):
            result.say(line)
        for name, path in written.items():
            result.say(f"{name}: {path}")


def _on_recording(
    recording: Path,
    part: str,
    trials: int,
    seed: int,
    jobs: int,
    out: Path | None,
    further: object,
    json_to: str | None,
    quiet: bool,
) -> None:
    from typing import get_args

    from benchctl.campaign.stop import stop_on_signals
    from benchctl.closeness import meant
    from benchctl.diagnosis.result import Part
    from benchctl.proof.on_recording import RecordingProof, as_json, prove_on, untouched_findings
    from benchctl.reports.proof_page import lines_on
    from benchctl_instruments.errors import UsageError

    with result_of("prove", json_to, quiet) as result:
        if part not in get_args(Part):
            raise UsageError(f"--part {part}: is no part of a bench; {meant(part, get_args(Part))}")
        if further:
            raise UsageError("--on: goes with --part, --trials, --seed, --jobs and --out; leave the others out")
        proof = RecordingProof(recording=recording, part=cast("Part", part), seed=seed, trials=trials, jobs=jobs)
        folder = out or Path("results") / f"prove_{recording.stem}_seed{seed}"
        with stop_on_signals() as stop, _progress(result, trials, quiet) as on_event:
            finished = list(prove_on(proof, folder, on_status=on_event, stop=stop))
        values = as_json(proof, untouched_findings(folder), finished)
        result.values |= {**values, "folder": folder}
        for line in lines_on(values):
            result.say(line)


def _generic(wanted: bool | None, result: Result) -> bool:
    from benchctl.proof.generic.arm import available
    from benchctl_instruments.errors import UsageError

    there = available()
    if wanted and not there:
        raise UsageError("--generic: pysindy is not installed; pip install 'benchctl[test]', or leave it out")
    if wanted is None and not there:
        result.say("without the sparse regression: pysindy is not installed (pip install 'benchctl[test]')")
    return there if wanted is None else wanted


@contextmanager
def _progress(result: Result, trials: int, quiet: bool) -> Iterator[Callable[[int, str], None]]:
    """Yield a callback that prints digests as lines and updates a progress bar at a terminal."""
    import threading

    from benchctl.cli.terminal import progress_bar

    done, lock = 0, threading.Lock()
    with progress_bar("sealed trials", quiet) as draw:

        def tell_of(index: int, what: str) -> None:
            nonlocal done
            with lock:
                sealed = what.startswith("sealed")
                done += not sealed
                if sealed:
                    result.say(f"trial {index} {what}")
                if draw is not None:
                    draw(f"trial {index}", done / trials, f"{done} of {trials} done")

        yield tell_of
