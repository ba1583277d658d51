"""Preview of a run without opening an instrument, for `check` and every `--dry-run`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchctl.app.run import questions_asked
from benchctl.atomic import free_bytes, require_empty
from benchctl.bench import Bench, Limits
from benchctl.campaign.check import bench_time_s, expiring, problems, refusal, room_problems
from benchctl.campaign.interlocks import words
from benchctl.campaign.operator import Answers, answer_line, operator_at_terminal, require_operator
from benchctl.campaign.resume import Past, steps_to_play
from benchctl.campaign.timing import disk_bytes, timeline
from benchctl.cli.messages import duration, size
from benchctl.cli.output import Result
from benchctl.plan import Plan, Sine, Step, ThermalRamp
from benchctl_instruments.errors import UsageError
from benchctl_instruments.rate_tables.manual import WARNING

_WORDS = {
    "static": "at rest",
    "constant_rate": "at constant rate",
    "sine": "sine",
    "thermal_ramp": "thermal ramp",
    "power_cycle": "powered off and on",
    "mount": "mounted by an operator",
    "ask": "done by an operator",
    "home": "homing",
}


def timeline_lines(plan: Plan, limits: Limits, from_c: float) -> Iterator[str]:
    """Yield one line per set point: start time, set point, duration and the runs there."""
    began_s, block, last_end_s, setpoint_c = 0.0, list[Step](), 0.0, from_c
    for step, (start_s, end_s, after_c) in zip(plan.steps, timeline(plan, limits, from_c), strict=True):
        if step.kind == "soak" and block:
            yield _line(began_s, last_end_s, setpoint_c, block)
            began_s, block = start_s, []
        block.append(step)
        last_end_s, setpoint_c = end_s, after_c
    yield _line(began_s, last_end_s, setpoint_c, block)


def _line(began_s: float, end_s: float, setpoint_c: float, block: list[Step]) -> str:
    parts = [_summary(kind, [step for step in block if step.kind == kind]) for kind in _WORDS]
    runs = ", ".join(part for part in parts if part) or "soak only"
    return f"{duration(began_s):>12}  {setpoint_c:+7.2f} °C  {duration(end_s - began_s):>12}  {runs}"


def _summary(kind: str, steps: list[Step]) -> str:
    if not steps:
        return ""
    words = f"{len(steps)} {_WORDS[kind]}"
    top_dps = max(step.peak_rate_dps for step in steps)
    if top_dps:
        words += f" to {top_dps:g} deg/s"
    if any(isinstance(step, Sine | ThermalRamp) and step.role == "verify" for step in steps):
        words += " (kept aside)"
    return words


def preview(result: Result, plan: Plan, bench: Bench, out: Path, past: Past | None = None) -> None:
    """Print steps, time, disk space, timeline, questions and interlocks of a plan.

    With `past`, only of the steps that remain. `out` is the campaign's folder. Raises `UsageError` after printing the
    `problems` if the bench cannot run the plan.
    """
    left = plan
    if past is not None:
        to_play = steps_to_play(plan, past.infos, bench.safe.chamber_c)
        left = replace(plan, steps=tuple(step for _, _, step in to_play))
    found = problems(plan, bench)
    playable = not found
    takes_s = bench_time_s(left, bench) if playable else None
    needs = disk_bytes(left, bench.recorded_hz) if playable else None
    free = free_bytes(out)
    found += room_problems(plan, bench, out) if playable else []
    warnings = [each.message for each in expiring(plan, bench, past.first if past else 1)] if playable else []
    warnings += [WARNING] if bench.by_hand else []
    questions = questions_asked(plan, bench, past)
    result.values |= {
        "steps": len(left.steps),
        "bench_time_s": takes_s,
        "disk_bytes": needs,
        "disk_free_bytes": free,
        "problems": [{"step": one.step, "says": one.message} for one in found],
        "warnings": warnings,
        "questions": [{"step": one.step, "says": one.text} for one in questions],
    }
    for warning in warnings:
        result.say(f"warning: {warning}")
    if found:
        for problem in found:
            result.say(f"step {problem.step}: {problem.message}")
        raise UsageError(refusal(plan, found))
    result.say(
        f"{plan.procedure} on {bench.name}: {len(left.steps)} steps, at least {duration(takes_s or 0)}, "
        f"{size(needs or 0)} on disk ({size(free)} are free at {out})"
    )
    for line in timeline_lines(left, bench.limits, bench.safe.chamber_c):
        result.say(line)
    if bench.interlocks:
        result.say(f"interlocks: {words(bench.interlocks)}")
    if questions:
        result.say(
            f"{len(questions)} questions to the operator; a file for benchctl run --answers would have these lines:"
        )
        for text in dict.fromkeys(question.text for question in questions):
            result.say(f"  {answer_line(text)}")


def preview_run(
    result: Result,
    plan: Plan,
    bench: Bench,
    out: Path,
    *,
    answers: Answers | None,
    at_page: bool = False,
    past: Past | None = None,
) -> None:
    """Print the preview of `run --dry-run`, with the first step; raise the errors that the run itself would raise.

    Among these is the error for questions without an answer and without an operator at the terminal or the live page.
    """
    result.values |= {"dry_run": True, "campaign": out, "first_step": past.first if past else 1}
    if past is None:
        require_empty(out)
    elif past.is_whole:
        result.say(f"{out}: all {len(plan.steps)} steps are complete; it would be closed, and nothing would move")
        return
    else:
        complete, label = past.first - 1, plan.steps[past.first - 1].label
        result.say(
            f"{out}: {complete} of {len(plan.steps)} steps are complete; it would go on with step {past.first}, {label}"
        )
    preview(result, plan, bench, out, past)
    if answers is not None:
        answers.refuse_unanswered(questions_asked(plan, bench, past))
    elif not bench.simulated and not at_page:
        to_play = steps_to_play(plan, past.infos if past else (), bench.safe.chamber_c)
        operator = operator_at_terminal(bench)
        steps = ((number, step) for _, number, step in to_play)
        require_operator(plan.procedure, steps, operator, by_hand=bench.by_hand)
    result.say("a dry run: no instrument was opened, and nothing has moved or been written")
