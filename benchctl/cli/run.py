"""`benchctl run`: run a campaign, resume one, or repeat one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.candidates import campaigns, procedures_named, recordings
from benchctl.cli.output import (
    BENCH,
    JsonOption,
    ParameterOption,
    QuietOption,
    SeedOption,
    UnitOption,
    out_option,
    parameters,
    result_of,
    toml_option,
)


def run(
    procedure: Annotated[
        str | None,
        typer.Argument(metavar="PROCEDURE", autocompletion=procedures_named, help="Its name, or a .py file."),
    ] = None,
    bench: Annotated[str | None, BENCH] = None,
    parameter: ParameterOption = None,
    unit: UnitOption = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the plan, its duration and disk space; execute nothing.")
    ] = False,
    answers: Annotated[
        Path | None, toml_option("--answers", "Answers to the operator's questions, as TOML: explained below.")
    ] = None,
    page: Annotated[
        str | None,
        typer.Option("--page", metavar="NAME", help="The operator, who answers the questions at the live page."),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(
            "--again",
            metavar="FIRST",
            autocompletion=recordings,
            help="Repeat the run of a recording, and compare.",
        ),
    ] = None,
    limits: Annotated[
        Path | None, toml_option("--limits", "Limits that judge the complete run; default for --again: those of FIRST.")
    ] = None,
    out: Annotated[Path | None, out_option("The campaign's folder; default: a new one in results/.")] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            "--resume",
            metavar="CAMPAIGN",
            autocompletion=campaigns,
            help="Resume a campaign that ended early.",
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Resume without confirmation before the table moves.")
    ] = False,
    seed: SeedOption = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a procedure, record it, fit it if it is a calibration, and judge it by --limits, as `benchctl accept` does.

    Or resume a campaign that ended early.

    Example: `benchctl run two_stage --bench simulated -p points=5 -p soak_s=1h`,
    `benchctl run two_stage --bench lab/bench.toml --dry-run`,
    `benchctl run two_stage --bench lab/bench.toml --resume results/20261120-180000_two_stage_SN-17`,
    `benchctl run --again first/recording.h5 --bench lab/bench.toml`,
    `benchctl run misalignment --bench lab/bench.toml --answers answers.toml`

    With --again FIRST, a recording or a campaign's folder, the procedure is repeated with the same parameters on the
    same unit: on --bench, or on the recorded bench if that was simulated (with new noise unless --seed is given).
    Reports what differs from FIRST: procedure, bench, instruments, software, and every test. The result is judged by
    --limits, or by the limits of the acceptance stored with FIRST: exit status 1 unless every test passes. Writes
    `rerun.json`.
    """
    from contextlib import nullcontext

    from benchctl.app import run as app
    from benchctl.app.notify import send_result
    from benchctl.campaign.operator import read_answers
    from benchctl.campaign.resume import past_of
    from benchctl.cli.campaigns import ask_to_resume, at_terminal, summary
    from benchctl.metrology.limit_file import read_limits
    from benchctl.plan.find import find_procedure
    from benchctl_instruments.errors import UsageError

    with result_of("run", json_to, quiet) as result:
        if page is not None and answers is not None:
            raise UsageError(f"--page {page}: the answers come from {answers}; leave one of them out")
        if unit is not None and bench is None:
            raise UsageError(f"--unit {unit}: names the unit on a bench; name the bench with --bench, too")
        _refuse_contradictions(procedure, parameter, again, out, resume)
        judged_by = None if limits is None or again is not None else read_limits(limits)
        answered = None if answers is None else read_answers(answers)
        loaded = None if bench is None else app.bench_of(bench, seed, unit)
        rerun = None
        if again is not None:
            from benchctl.cli.rerunning import to_run_again

            rerun = to_run_again(again, bench=loaded, limits=limits, seed=seed)
            plan, loaded = rerun.plan, rerun.bench
        elif procedure is None or loaded is None:
            raise UsageError("run needs a procedure (benchctl procedures lists them) and --bench, or --again FIRST")
        else:
            plan = find_procedure(procedure).expand(parameters(parameter))
        folder, seeded = out or resume or app.new_folder(plan.procedure, loaded.unit.serial), seed is not None
        if dry_run:
            from benchctl.cli.dry_run import preview_run

            with past_of(folder, plan, loaded, seeded=seeded) if resume else nullcontext() as past:
                stands, at_page = past.bench if past else loaded, page is not None
                preview_run(result, plan, stands, folder, answers=answered, at_page=at_page, past=past)
            return
        watch = at_terminal(quiet)
        if resume is None:
            outcome = app.play(plan, loaded, folder, watch=watch, answers=answered, page=page)
        else:
            ask = None if yes else ask_to_resume
            outcome = app.resume(
                plan, loaded, folder, watch=watch, seeded=seeded, answers=answered, page=page, confirm=ask
            )
        result.values |= {"campaign": outcome.campaign, **outcome.values()}
        result.say(summary(outcome))
        outcome.raise_error()
        if plan.calibrates:
            from benchctl.app.fit import fit

            fitted = fit([outcome.recording], out=outcome.campaign)
            result.values |= {"coefficients": fitted.files["coefficients"], "error_percent": fitted.error_percent}
            result.say(fitted.says)
            result.say_files(fitted.files)
            send_result(plan, loaded, outcome.campaign, fitted.says.partition("\n")[0], watch.warn)
        if judged_by is not None:
            from benchctl.app.accept import accept

            judged = accept(outcome.campaign, judged_by).write(outcome.campaign)
            result.values |= {"verdict": judged.verdict, **judged.files}
            result.say(str(judged))
            result.say_files(judged.files)
            send_result(plan, loaded, outcome.campaign, str(judged).splitlines()[-1], watch.warn)
            if judged.fails:
                result.fail(judged.fails)
        if rerun is not None:
            rerun.tell(outcome, result, watch.warn)


def further_help() -> str:
    """Return an example of the file of answers."""
    return """An operator's answers, for a plan with actions of an operator where there is none, as in CI: each
question in full, as benchctl check lists it, and "done", or "refuse", which ends the run safely with exit status 3.
Nothing moves where a question has no answer.

    "close the chamber's door" = "done"
    "switch the supply of unit SN-17 off" = "refuse"
"""


def _refuse_contradictions(
    procedure: str | None,
    parameter: list[str] | None,
    again: Path | None,
    out: Path | None,
    resume: Path | None,
) -> None:
    from benchctl_instruments.errors import UsageError

    if resume is not None and out is not None:
        raise UsageError(f"--out {out}: a campaign that is resumed stays in its folder, {resume}")
    if again is None:
        return
    if procedure is not None:
        raise UsageError(f"--again {again}: names its procedure itself; leave {procedure} out")
    if parameter:
        raise UsageError(f"--again {again}: is run with its own parameters; leave -p {parameter[0]} out")
    if resume is not None:
        raise UsageError(
            f"--again {again}: begins a campaign, --resume {resume} goes on with one; leave one of them out"
        )
