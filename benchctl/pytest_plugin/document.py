"""A file of a campaign and its limits, read and looked at before anything is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from benchctl import api
from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.metrology.limit_file import Limits, read_limits
from benchctl.plan import Plan
from benchctl.toml_file import parse_toml, read_text
from benchctl_instruments.errors import UsageError


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    procedure: str = Field(min_length=1)
    bench: str = SIMULATED
    limits: str = ""
    seed: int | None = Field(default=None, ge=0)
    parameters: dict[str, bool | int | float | str | list[float]] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchTest:
    """A plan on a bench, and the limits that judge its recording; None: it need only be complete."""

    plan: Plan
    bench: Bench
    limits: Limits | None


def read_bench_test(path: Path) -> BenchTest:
    """What a file says, its paths taken from where it lies.

    Raises
    ------
    UsageError
        Where it, or a file that it names, is not there or has a wrong field, or its parameters give no plan.
    """
    told = parse_toml(read_text(path, "bench test"), _File, str(path))
    place = path.parent
    try:
        procedure = str(place / told.procedure) if told.procedure.endswith(".py") else told.procedure
        bench = load_bench(told.bench if told.bench == SIMULATED else str(place / told.bench))
        if told.seed is not None and not bench.simulated:
            raise UsageError(f"seed = {told.seed}: only a bench with simulated = true has a seed; {told.bench} is none")
        return BenchTest(
            plan=api.plan(procedure, **told.parameters),
            bench=bench.with_seed(told.seed),
            limits=read_limits(place / told.limits) if told.limits else None,
        )
    except UsageError as err:
        raise UsageError(f"{path}: {err}") from err
