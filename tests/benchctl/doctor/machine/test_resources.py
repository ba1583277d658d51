import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.doctor.machine.resources import resource_findings

resource = pytest.importorskip("resource", reason="limits of POSIX")

MEMORY = "MemTotal:       {total} kB\nMemFree:          1000 kB\nMemAvailable:   {free} kB\n"


def _memory(root: Path, total: int, free: int) -> Path:
    (root / "proc").mkdir(exist_ok=True)
    (root / "proc/meminfo").write_text(MEMORY.format(total=total, free=free))
    return root


def test_little_memory_is_a_warning(tmp_path: Path) -> None:
    told = {finding.what: finding for finding in resource_findings(_memory(tmp_path, 8_000_000, 1_000_000))}
    assert (told["memory"].verdict, told["memory"].says) == ("look", "1.0 GB of 8.2 GB are free")
    told = {finding.what: finding for finding in resource_findings(_memory(tmp_path, 8_000_000, 6_000_000))}
    assert told["memory"].verdict == "ok"


def test_a_container_has_what_its_group_allows(tmp_path: Path) -> None:
    _memory(tmp_path, 8_000_000, 6_000_000)
    (tmp_path / "sys/fs/cgroup").mkdir(parents=True)
    limit = tmp_path / "sys/fs/cgroup/memory.max"
    limit.write_text("1500000000\n")
    told = {finding.what: finding for finding in resource_findings(tmp_path)}
    assert told["memory"].verdict == "look"
    assert "this container may have 1.5 GB" in told["memory"].says
    limit.write_text("max\n")
    assert {finding.what: finding.verdict for finding in resource_findings(tmp_path)}["memory"] == "ok"


def test_few_open_files_are_a_warning_with_the_command_that_allows_more() -> None:
    code = (
        "from benchctl.doctor.machine.resources import resource_findings\n"
        "print(*[f'{each.verdict}: {each.do}' for each in resource_findings() if each.what == 'open files'])"
    )

    def few() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (100, 500))

    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, preexec_fn=few)
    assert ran.stdout.strip() == "look: ulimit -n 500 before benchctl"
