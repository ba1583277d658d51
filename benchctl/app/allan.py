"""Compute the Allan deviation of a channel, or of a column of a text file, and write the report.

The analysis and the figures are loaded late, so that unusable input is refused without delay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchctl.metrology.series import series_of_step, series_of_text
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.reader import open_recording
from benchctl.reports.results import name_of
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    from benchctl.metrology.allan import Allan

_TEXTS = (".csv", ".txt", ".dat", ".gz")


@dataclass(frozen=True, slots=True, kw_only=True)
class AllanResult:
    """An Allan analysis; `print` shows the text of `benchctl allan`.

    `analysis` has the averaging times in s, the deviations in the unit of its series, and the noise terms with 95 %
    intervals, or the reason why a term is refused. `files` are the paths of `report` and `table`, if they were written.
    """

    analysis: Allan = field(repr=False)
    source: Path
    files: Mapping[str, Path] = field(default_factory=dict)

    def __str__(self) -> str:
        from benchctl.reports.allan_report import lines

        return lines(self.analysis)

    def values(self) -> dict[str, Any]:
        """Return the data for `--json`."""
        from benchctl.reports.allan_report import values

        return values(self.analysis)

    def write(self, folder: Path) -> AllanResult:
        """Write page and table into a folder and its manifest, and return the result with their paths.

        Raises `UsageError` if they cannot be written.
        """
        from benchctl.reports.allan_report import write_report

        report, table = write_report(self.analysis, folder, name_of(self.source))
        add_to_manifest(folder, [report, table])
        return replace(self, files={"report": report, "table": table})


def allan(
    source: Path,
    *,
    channel: str | None = None,
    rate_hz: float | None = None,
    step: str | None = None,
    scale_v_per_dps: float | None = None,
) -> AllanResult:
    """Analyse a channel of a recording, or a column of a text file.

    `rate_hz` is the sample rate of a text file without a time column. `step` is a step of a recording, by default its
    longest static one; `scale_v_per_dps` is the scale factor by which its gyro_v is a rate.

    Raises
    ------
    UsageError
        If the source cannot be read or has no such channel or step, a number cannot be, or one does not belong to the
        kind of source.
    """
    if rate_hz is not None and not 0.0 < rate_hz < math.inf:
        raise UsageError(f"--rate-hz {rate_hz:g}: expected samples a second, a positive number")
    if scale_v_per_dps is not None and not 0.0 < abs(scale_v_per_dps) < math.inf:
        raise UsageError(f"--scale-v-per-dps {scale_v_per_dps:g}: expected volts for a degree a second, not 0")
    if source.suffix.lower() in _TEXTS:
        if step is not None or scale_v_per_dps is not None:
            raise UsageError("--step and --scale-v-per-dps are for recordings, a text file has neither; leave them out")
        series = series_of_text(source, channel, rate_hz)
    elif rate_hz is not None:
        raise UsageError("--rate-hz is for text files, a recording knows when each sample was taken; leave it out")
    else:
        with open_recording(source) as recording:
            series = series_of_step(recording, channel, step, scale_v_per_dps)
    from benchctl.metrology.allan import analysed

    return AllanResult(analysis=analysed(series), source=source)
