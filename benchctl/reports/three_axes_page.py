"""The report on a unit of three axes: its matrix, its biases, and their change with temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchctl.calibration.three_axes import AxesEstimate, ThreeAxesResult
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import setup_section, text, verdict
from benchctl.reports.html import render
from benchctl_instruments.mounting import AXES


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesTable:
    """Values with expanded uncertainties as text: a row an output, with the columns after its name."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def axes_tables(result: ThreeAxesResult) -> Iterator[AxesTable]:
    """Yield the table at T0 and, if the temperatures differ, that of the changes per °C."""
    yield _table(f"three axes at {text.plain(result.T0_c, '°C')}", "deg/s", result.at_T0)
    if result.per_c is not None:
        yield _table("change per °C", "deg/s/°C", result.per_c)


def _table(title: str, bias_unit: str, estimate: AxesEstimate) -> AxesTable:
    value, expanded = estimate.value, estimate.expanded
    return AxesTable(
        title=title,
        columns=(*(f"about {axis}" for axis in AXES), f"bias, {bias_unit}"),
        rows=tuple(
            (
                axis,
                *(
                    text.with_uncertainty(float(number), float(of_it))
                    for number, of_it in zip(value.matrix[row], expanded.matrix[row], strict=True)
                ),
                text.with_uncertainty(float(value.bias_dps[row]), float(expanded.bias_dps[row])),
            )
            for row, axis in enumerate(AXES)
        ),
    )


def three_axes_page(result: ThreeAxesResult, meta: Meta, infos: Sequence[StepInfo], *, digest: str) -> str:
    """Return the page as text; `digest` is the recordings'."""
    rows = [
        ("Positions", ", ".join(result.positions)),
        ("Steps in these positions", text.count(result.steps)),
        ("Rates", text.span(*result.rate_dps, "°/s")),
        ("Temperature", text.span(*result.temperature_c, "°C")),
    ]
    return render(
        "three_axes.html.j2",
        meta=meta,
        status=verdict.status_text(meta),
        result=result,
        tables=list(axes_tables(result)),
        setup=[*setup_section.facts(meta, infos), *rows],
        provenance_rows=setup_section.provenance(meta, digest),
    )
