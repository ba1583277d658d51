"""pytest items of a file that describes a campaign and its limits: the campaign, and each limit.

The campaign is run and judged once per session, by the first process that needs it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from pydantic import BaseModel, ConfigDict, Field

from benchctl import api
from benchctl.app.accept import accept
from benchctl.app.run import bench_of, free_folder
from benchctl.bench import SIMULATED, Bench
from benchctl.campaign.stop import StoppedError
from benchctl.metrology.limit_file import Limits, read_limits
from benchctl.plan import Plan
from benchctl.pytest_plugin.fixtures import ENDING
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.acceptance.write import properties_of, reason_of
from benchctl.toml_file import parse_toml, read_text
from benchctl_instruments.errors import BenchError, UsageError


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    procedure: str = Field(min_length=1)
    bench: str = SIMULATED
    limits: str = ""
    seed: int | None = Field(default=None, ge=0)
    parameters: dict[str, Any] = Field(default_factory=dict)  # the procedure checks them


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchTest:
    """A plan on a bench, and the limits of its recording; with None, the campaign passes if it is complete."""

    plan: Plan
    bench: Bench
    limits: Limits | None


def read_bench_test(path: Path) -> BenchTest:
    """Read a file; its paths are relative to its folder.

    Raises
    ------
    UsageError
        If it, or a file that it names, does not exist or has a wrong field, or its parameters give no plan.
    """
    content = parse_toml(read_text(path, "bench test"), _File, str(path))
    place = path.parent
    try:
        procedure = str(place / content.procedure) if content.procedure.endswith(".py") else content.procedure
        bench = content.bench if content.bench == SIMULATED else str(place / content.bench)
        return BenchTest(
            bench=bench_of(bench, content.seed),
            plan=api.plan(procedure, **content.parameters),
            limits=read_limits(place / content.limits) if content.limits else None,
        )
    except UsageError as err:
        raise UsageError(f"{path}: {err}") from err


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The verdict on one limit: PASS, FAIL or INCONCLUSIVE, the reason, and the values by name."""

    verdict: str
    reason: str
    properties: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """The result of a campaign: `error` states why it is incomplete or could not be judged, otherwise empty.

    `figures` are values by name; `report` is the path of the acceptance report, empty if the campaign is not kept.
    """

    error: str
    figures: dict[str, str]
    report: str
    tests: dict[str, Verdict]


def judged(test: BenchTest, path: Path, shared: Path, out: Path | None) -> Judged:
    """Return the result of the campaign of a file; run it if no process of this session has done so.

    `shared` is the folder that these processes share; if `out` is given, the campaign is kept there.
    """
    shared.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(str(path).encode()).hexdigest()[:16]
    with FileLock(shared / f"{name}.lock"):
        state = shared / f"{name}.json"
        if not state.exists():
            folder = free_folder(out or shared / "campaigns", path.name.removesuffix(ENDING))
            found = _run(test, folder, kept=out is not None)
            state.write_text(json.dumps(asdict(found)), encoding="utf-8")
        stored = json.loads(state.read_text(encoding="utf-8"))
    return Judged(**{**stored, "tests": {name: Verdict(**one) for name, one in stored["tests"].items()}})


def _run(test: BenchTest, folder: Path, *, kept: bool) -> Judged:
    try:
        outcome = api.run(test.plan, test.bench, out=folder, check=False)
        figures = {
            "recording": str(outcome.recording),
            "status": outcome.status,
            "steps": f"{outcome.whole} of {outcome.planned}",
            "samples": str(outcome.samples),
            "bench_time_s": f"{outcome.bench_time_s:.1f}",
        }
        if outcome.error is not None:
            return Judged(error=f"{outcome.status}: {outcome.error}", figures=figures, report="", tests={})
        if test.limits is None:
            return Judged(error="", figures=figures, report="", tests={})
        accepted = accept(outcome.recording, test.limits)
        if kept:
            accepted = accepted.write(folder)
    except BenchError as err:
        return Judged(error=str(err), figures={}, report="", tests={})
    words = catalogue("en")
    tests = {
        one.measured.name: Verdict(
            verdict=str(one.verdict),
            reason=reason_of(one, words),
            properties=properties_of(one),
        )
        for one in accepted.tests
        if one.limit is not None
    }
    return Judged(error="", figures=figures, report=str(accepted.files.get("report", "")), tests=tests)


class BenchTestFile(pytest.File):
    """A file that describes a campaign and its limits; `shared` is the folder shared by the session's processes."""

    def __init__(self, *, shared: Path, **more: Any) -> None:
        super().__init__(**more)
        self._shared = shared

    def collect(self) -> Iterator[pytest.Item]:
        """Yield the campaign, then a test for each limit, in the order of the file of limits."""
        try:
            test = read_bench_test(self.path)
        except UsageError as err:
            raise self.CollectError(str(err)) from None
        yield CampaignItem.from_parent(self, name="campaign", test=test)
        for name in test.limits.limits if test.limits else ():
            yield LimitItem.from_parent(self, name=name, test=test)

    def judged(self, test: BenchTest) -> Judged:
        """Return the result of the campaign."""
        kept = self.config.getoption("--benchctl-out")
        out = self.config.invocation_params.dir / kept if kept else None
        try:
            return judged(test, self.path, self._shared, out)
        except StoppedError as err:
            pytest.exit(f"benchctl: {err}", returncode=pytest.ExitCode.INTERRUPTED)


class NotPassedError(Exception):
    """A campaign that is not complete, or a limit that is not met; reported in one line."""


class _Item(pytest.Item):
    """Base class of both kinds of item."""

    parent: BenchTestFile

    def __init__(self, *, test: BenchTest, **more: Any) -> None:
        super().__init__(**more)
        self._test = test

    def setup(self) -> None:
        """Skip benches that are not simulated, unless --benchctl-hardware is given."""
        if not self._test.bench.simulated and not self.config.getoption("--benchctl-hardware"):
            pytest.skip(f"{self._test.bench.name} is not a simulated bench: give --benchctl-hardware to let it move")

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the file and the name of the test in it."""
        return self.path, None, f"{self.path.name}: {self.name}"

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return a failed test's message as one line; any other exception with its traceback."""
        if isinstance(excinfo.value, NotPassedError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)


class CampaignItem(_Item):
    """The campaign: it passes if every step was run and the bench came to rest."""

    def runtest(self) -> None:
        """Run it, unless another item has done so."""
        found = self.parent.judged(self._test)
        self.user_properties += found.figures.items()
        if found.error:
            raise NotPassedError(found.error)


class LimitItem(_Item):
    """One limit."""

    def runtest(self) -> None:
        """Check the verdict on the campaign's recording."""
        found = self.parent.judged(self._test)
        if found.error:
            raise NotPassedError(f"not judged, since the campaign is not complete: {found.error}")
        one = found.tests[self.name]
        self.user_properties += [("verdict", one.verdict), *one.properties.items()]
        if one.verdict != "PASS":
            report = f" (report: {found.report})" if found.report else ""
            raise NotPassedError(f"{one.verdict}: {one.reason}{report}")
