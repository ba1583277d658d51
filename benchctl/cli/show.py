"""`benchctl show`: show the contents of a recording."""

from __future__ import annotations

from typing import Any

from benchctl.cli.output import JsonOption, QuietOption, RecordingArgument, result_of


def show(
    recording: RecordingArgument,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Show the contents of a recording: steps, channels, units, provenance, integrity.

    Example: `benchctl show results/20261120-180000_two_stage_SIM-0001`
    """
    from benchctl.recordings.reader import open_recording
    from benchctl.recordings.verify import summarise

    with result_of("show", json_to, quiet) as result:
        with open_recording(recording) as opened:
            summary = summarise(opened)
            unit = opened.meta.unit
        result.values |= summary
        result.say(f"{recording}: {summary['status']}, unit {unit.serial} {unit.model}".rstrip())
        result.say(f"digests: {_INTEGRITY[summary['digest_ok']]}")
        for problem in summary["problems"]:
            result.say(f"  {problem}")
        for key, text in summary["provenance"].items():
            if text and "\n" not in text and len(text) < 160:
                result.say(f"{key}: {text}")
        for channel in summary["channels"]:
            rate = f"{channel['rate_hz']:g} Hz" if channel["rate_hz"] else "polled, or by step"
            result.say(f"channel {channel['name']}: {channel['unit']}, {rate}")
        for step in summary["steps"]:
            result.say(_line(step))


_INTEGRITY = {True: "nothing changed since it was written", False: "CHANGED since it was written", None: "none yet"}


def _line(step: dict[str, Any]) -> str:
    lost = step.get("frames_lost", 0)
    faults = (("CUT", not step["whole"]), (f"{step['gaps']} gaps", step["gaps"]), (f"{lost} frames lost", lost))
    marks = [mark for mark, present in faults if present]
    return (
        f"{step['index']:4d}  {step['name']:<32} {step['kind']:<14} {step['role']:<7} {step['samples']:>9,} samples  "
        f"{step['t_start']:.1f} to {step['t_end']:.1f} s  {' '.join(marks)}"
    ).rstrip()
