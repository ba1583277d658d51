"""What a run would do, without an instrument: said by `check`, and by every `--dry-run`."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

from benchctl.atomic import free_bytes, require_empty
from benchctl.bench import Bench
from benchctl.campaign.answers import Answers, answer_line
from benchctl.campaign.check import bench_time_s, problems, refusal, room_problems
from benchctl.campaign.expiry import expiring
from benchctl.campaign.hands import hands_at_the_terminal, refuse_without_hands
from benchctl.campaign.interlocks import words
from benchctl.campaign.playing import questions_asked
from benchctl.campaign.resume import Past, steps_to_play
from benchctl.campaign.timing import disk_bytes
from benchctl.cli.output import Result
from benchctl.cli.timeline import timeline_lines
from benchctl.cli.words import duration, size
from benchctl.plan import Plan
from benchctl_instruments.errors import UsageError


def foretell(result: Result, plan: Plan, bench: Bench, out: Path, past: Past | None = None) -> None:
    """Tell steps, time, disk, timeline, questions and interlocks of a plan, or of what is left of it after its `past`.

    `out` is where the campaign is to land. Raises `UsageError`, its `problems` told, where the bench cannot play it.
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
    warnings = [each.says for each in expiring(plan, bench, past.first if past else 1)] if playable else []
    asked = questions_asked(plan, bench, past)
    result.values |= {
        "steps": len(left.steps),
        "bench_time_s": takes_s,
        "disk_bytes": needs,
        "disk_free_bytes": free,
        "problems": [asdict(problem) for problem in found],
        "warnings": warnings,
        "questions": [asdict(question) for question in asked],
    }
    for warning in warnings:
        result.say(f"warning: {warning}")
    if found:
        for problem in found:
            result.say(f"step {problem.step}: {problem.says}")
        raise UsageError(refusal(plan, found))
    result.say(
        f"{plan.procedure} on {bench.name}: {len(left.steps)} steps, at least {duration(takes_s or 0)}, "
        f"{size(needs or 0)} on disk ({size(free)} are free at {out})"
    )
    for line in timeline_lines(left, bench.limits, bench.safe.chamber_c):
        result.say(line)
    if bench.interlocks:
        result.say(f"interlocks: {words(bench.interlocks)}")
    if asked:
        result.say(f"{len(asked)} questions to the operator; a file for benchctl run --answers would have these lines:")
        for says in dict.fromkeys(question.says for question in asked):
            result.say(f"  {answer_line(says)}")


def foretell_run(
    result: Result, plan: Plan, bench: Bench, out: Path, *, answers: Answers | None, past: Past | None = None
) -> None:
    """What `run --dry-run` tells: also from which step on, and that nobody could answer; raises what the run would."""
    result.values |= {"dry_run": True, "campaign": out, "first_step": past.first if past else 1}
    if past is None:
        require_empty(out)
    elif past.is_whole:
        result.say(f"{out}: all {len(plan.steps)} steps are whole; it would be closed, and nothing would move")
        return
    else:
        whole, label = past.first - 1, plan.steps[past.first - 1].label
        result.say(
            f"{out}: {whole} of {len(plan.steps)} steps are whole; it would go on with step {past.first}, {label}"
        )
    foretell(result, plan, bench, out, past)
    if answers is not None:
        answers.refuse_unanswered(questions_asked(plan, bench, past))
    elif not bench.simulated:
        to_play = steps_to_play(plan, past.infos if past else (), bench.safe.chamber_c)
        hands = hands_at_the_terminal(bench)
        refuse_without_hands(plan.procedure, ((number, step) for _, number, step in to_play), hands)
    result.say("a dry run: no instrument was opened, and nothing has moved or been written")
