"""`benchctl apply`: write the compensated rate of a recording to a separate file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from benchctl.cli.output import (
    JsonOption,
    QuietOption,
    RecordingArgument,
    beside,
    refuse_existing,
    refuse_folder,
    result_of,
)


class LawChoice(StrEnum):
    """The law of the coefficients to apply."""

    joint = "joint"
    stages = "stages"


def apply(
    recording: RecordingArgument,
    coefficients: Annotated[
        Path, typer.Option("--coefficients", metavar="FILE", help="The coefficients.json that benchctl fit wrote.")
    ],
    law: Annotated[LawChoice | None, typer.Option("--law", help="Default: the joint fit, if there is one.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.h5", help="Default: NAME_compensated.h5 in the same folder."),
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Compensate a recording: write a copy with the compensated rate in an additional channel, `compensated_dps`.

    A second channel, `compensated_valid`, is 1 where rate and temperature are in the range in which the coefficients
    were measured. The original recording is not changed.

    Example: `benchctl apply recording.h5 --coefficients coefficients.json`
    """
    from benchctl.calibration.compensating import read_compensation, write_compensated
    from benchctl.recordings.campaign_manifest import add_to_manifest
    from benchctl.recordings.reader import open_recording
    from benchctl.recordings.verify import refuse_changed
    from benchctl.reports.results import source_digest
    from benchctl_instruments.errors import UsageError

    with result_of("apply", json_to, quiet) as result:
        target = output or beside(recording, "_compensated.h5")
        refuse_existing(target)
        refuse_folder(target)
        compensation = read_compensation(coefficients, None if law is None else law.value)
        refuse_changed(recording, "compensated")
        with open_recording(recording) as opened:
            digest = source_digest(opened)
            if not digest:
                raise UsageError(f"{recording}: has no digest yet; let it end, or close it with benchctl recover")
            applied = write_compensated(target, opened, compensation, digest=digest, coefficients=coefficients.name)
        add_to_manifest(target.parent, [target])
        result.values |= {
            "recording": target,
            "coefficients": coefficients,
            "law": compensation.by,
            "samples": applied.samples,
            "outside": applied.outside,
            "outside_most": {"rate_dps": applied.most_dps, "temperature_c": applied.most_c},
            "steps_without_temperature": list(applied.without),
            "delay_s": compensation.law.delay_s,
        }
        result.say(
            f"{target}: {applied.samples:,} samples compensated, law {compensation.law.name} of the "
            f"{'joint fit' if compensation.by == 'joint' else 'stages'}; a rate belongs to time_s less "
            f"{1e3 * compensation.law.delay_s:.4g} ms"
        )
        if applied.outside:
            result.say(
                f"note: {applied.outside:,} samples lie where the coefficients were not measured, by up to "
                f"{applied.most_dps:.3g} deg/s and {applied.most_c:.3g} degC: 0 in compensated_valid"
            )
        if applied.without:
            result.say(
                f"note: {len(applied.without)} steps have no gyro_temp_c and got no rate: "
                f"{', '.join(map(str, applied.without[:20]))}{', …' if len(applied.without) > 20 else ''}"
            )
