"""The code blocks of the README and of the handbook, and a shell that runs one as a reader would."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "benchctl" / "handbook").glob("*.md")))

_FENCE = re.compile(r"^(?:<!-- (?P<mark>.+?) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S)
_AS_A_READER = r"""
set -eu
trap 'kill $(jobs -p) 2> /dev/null || true' EXIT
pip() { :; }                                                    # all is installed
pytest() { python -m pytest "$@"; }
dask() { [ "$1" = scheduler ] || [ "$2" = tcp://lab-server:8786 ]; }
ssh-keygen() {
  case "$1" in
    -t)                                                         # no passphrase; the lab lists the key
      printf '\n\n' | command ssh-keygen "$@"
      echo "anna@lab.example $(cat anna.pub)" > allowed_signers ;;
    *) command ssh-keygen "$@" ;;
  esac
}
benchctl() {
  case "$*" in
    "serve "*) timeout -s INT 8 python -m benchctl "$@" | grep '"url"' ;;
    "sim "*) python -m benchctl "$@" & until [ -s sim.toml ]; do sleep 0.1; done ;;
    "run static --bench sim.toml") python -m benchctl check static --bench sim.toml ;;  # in real time it takes minutes
    "run two_stage "*" --out first") python -m benchctl "$@" -p points=4 ;;     # test_main_job.py runs all of it
    "run acceptance "*" --out unit17")
      python -m benchctl "$@" -p points=3 -p cycles=3 -p top_rate_dps=170 -p sweep_rates=5 -p rates=2 -p rest_s=600 \
        -p warm_s=600 -p soak_s=60 -p run_s=10 -p zero_s=20 -p small_run_s=20 ;;
    "run acceptance "*" --out first") mv unit17 first ;;         # the README's block has run the same
    "run --again first/"*) ;;                                   # and this too
    *--resume*) python -m benchctl "$@" --yes ;;                # there is no terminal to confirm at
    *tcp://lab-server*) ;;
    *) python -m benchctl "$@" || [ $? = 1 ] ;;                 # 1: it works, and a unit or a comparison fails
  esac
}
"""


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: its page, the line of its fence, the mark above it, its language and its text."""

    page: Path
    line: int
    mark: str
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.name}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """All blocks of a page."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text.count("\n", 0, one.start("language")) + 1, one["mark"] or "", one["language"], one["text"])
        for one in _FENCE.finditer(text)
    ]


def handbook(topic: str, language: str = "") -> list[Block]:
    """The blocks of a page of the handbook, or those in one language."""
    found = blocks(ROOT / "benchctl" / "handbook" / f"{topic}.md")
    return [one for one in found if language in ("", one.language)]


def run_block(block: Block, folder: Path, programs: Path) -> str:
    """Run a block of shell in a folder, up to its first command that fails; what it said on stdout.

    `programs` has the Python that is called `python`. What cannot run here is replaced: see `_AS_A_READER`.
    """
    environment = {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    ran = subprocess.run(
        ["bash", "-c", _AS_A_READER + block.text],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=1500,
    )
    assert ran.returncode == 0, f"{block}: exit status {ran.returncode}\n{ran.stdout}\n{ran.stderr}"
    return ran.stdout
