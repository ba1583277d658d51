"""A file of a campaign and its limits as tests of pytest: the campaign, and each limit by itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchctl.campaign.stop import StoppedError
from benchctl.pytest_plugin.document import BenchTest, read_bench_test
from benchctl.pytest_plugin.judged import Judged, judged
from benchctl_instruments.errors import UsageError


class BenchTestFile(pytest.File):
    """The file; `shared` is the folder that the processes of the session share."""

    def __init__(self, *, shared: Path, **more: Any) -> None:
        super().__init__(**more)
        self._shared = shared

    def collect(self) -> Iterator[pytest.Item]:
        """The campaign, then a test for each limit, in the order in which the file of limits has them."""
        try:
            test = read_bench_test(self.path)
        except UsageError as err:
            raise self.CollectError(str(err)) from None
        yield CampaignItem.from_parent(self, name="campaign", test=test)
        for name in test.limits.limits if test.limits else ():
            yield LimitItem.from_parent(self, name=name, test=test)

    def judged(self, test: BenchTest) -> Judged:
        """What became of the campaign."""
        kept = self.config.getoption("--benchctl-out")
        out = self.config.invocation_params.dir / kept if kept else None
        try:
            return judged(test, self.path, self._shared, out)
        except StoppedError as err:
            pytest.exit(f"benchctl: {err}", returncode=pytest.ExitCode.INTERRUPTED)


class NotPassedError(Exception):
    """A campaign that was not completed, or a limit that is not kept; told in a line."""


class _Item(pytest.Item):
    """What both kinds of item have."""

    parent: BenchTestFile

    def __init__(self, *, test: BenchTest, **more: Any) -> None:
        super().__init__(**more)
        self._test = test

    def setup(self) -> None:
        """Nothing real is moved by whoever only asked for the tests of a folder."""
        if not self._test.bench.simulated and not self.config.getoption("--benchctl-hardware"):
            pytest.skip(f"{self._test.bench.name} is no simulated bench: say --benchctl-hardware to let it move")

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """The file and the test's name in it."""
        return self.path, None, f"{self.path.name}: {self.name}"

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """One line for what was measured; what else goes wrong with its traceback."""
        if isinstance(excinfo.value, NotPassedError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)


class CampaignItem(_Item):
    """The campaign: it passes where every step was played and the bench came to rest."""

    def runtest(self) -> None:
        """Run it, unless that was done."""
        found = self.parent.judged(self._test)
        self.user_properties += found.told.items()
        if found.error:
            raise NotPassedError(found.error)


class LimitItem(_Item):
    """One limit."""

    def runtest(self) -> None:
        """See how the campaign's recording was judged."""
        found = self.parent.judged(self._test)
        if found.error:
            raise NotPassedError(f"not judged, since the campaign is not complete: {found.error}")
        one = found.tests[self.name]
        self.user_properties += [("verdict", one.verdict), *one.properties.items()]
        if one.verdict != "PASS":
            report = f" (report: {found.report})" if found.report else ""
            raise NotPassedError(f"{one.verdict}: {one.says}{report}")
