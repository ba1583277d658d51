"""`benchctl prove`: sealed trials of the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchctl.cli.output import JsonOption, QuietOption, Result, result_of

if TYPE_CHECKING:
    from benchctl.proof.running import ProofSettings


def prove(
    trials: Annotated[
        int | None, typer.Option("--trials", metavar="N", min=1, help="How many; default: 340, shared out by class.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Draws what the trials conceal.")] = 1,
    only: Annotated[
        list[str] | None, typer.Option("--class", metavar="NAME", help="A class of trials; default: all.")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", min=1, help="Trials that run at once.")] = 2,
    generic: Annotated[
        bool | None,
        typer.Option("--generic/--no-generic", help="A sparse regression (pysindy) beside it; default: if installed."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where trials are kept; default: results/prove_seed….")
    ] = None,
    keep: Annotated[bool, typer.Option("--keep", help="Keep the recordings, 4 MB each.")] = False,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Draw concealed effects, run the simulated bench through its wires, diagnose blind, unseal and score.

    The digest of what a trial conceals is printed before it is diagnosed. Stopped by Ctrl-C, the same command goes on
    where it was. Example: `benchctl prove --trials 22 --seed 7`
    """
    from benchctl.campaign.stop import stop_on_signals
    from benchctl.proof.running import ProofSettings, run_proof
    from benchctl.proof.summary import summarize
    from benchctl.reports.proof_lines import lines
    from benchctl.reports.proof_page import write_proof_report

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
        with stop_on_signals() as stop, _told(result, settings, quiet) as told:
            finished = list(run_proof(settings, folder, told=told, stop=stop))
        summary = summarize(seed, finished)
        written = write_proof_report(folder, summary)
        result.values |= {**summary.as_json(), **written, "folder": folder}
        for line in lines(summary):
            result.say(line)
        for name, path in written.items():
            result.say(f"{name}: {path}")


def _generic(wanted: bool | None, result: Result) -> bool:
    from benchctl.proof.generic.arm import available
    from instruments.errors import UsageError

    there = available()
    if wanted and not there:
        raise UsageError("--generic: pysindy is not installed; pip install 'benchctl[test]', or leave it out")
    if wanted is None and not there:
        result.say("without the sparse regression: pysindy is not installed (pip install 'benchctl[test]')")
    return there if wanted is None else wanted


@contextmanager
def _told(result: Result, settings: ProofSettings, quiet: bool) -> Iterator[Callable[[int, str], None]]:
    """Digests as lines, and a bar where there is a terminal."""
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
                    draw(f"trial {index}", done / settings.trials, f"{done} of {settings.trials} done")

        yield tell_of
