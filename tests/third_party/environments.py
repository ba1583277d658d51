"""Fresh virtual environments that see what this one has installed, so that nothing is downloaded for them."""

from __future__ import annotations

import os
import site
import sysconfig
import venv
from pathlib import Path


def fresh_environment(place: Path, *, with_pip: bool = False) -> Path:
    """The folder of the programs of a new environment in a folder."""
    venv.create(place, with_pip=with_pip, symlinks=os.name != "nt")
    paths = sysconfig.get_paths("venv", vars={"base": str(place), "platbase": str(place)})
    ours = [path for path in (*site.getsitepackages(), sysconfig.get_path("purelib")) if Path(path).is_dir()]
    seen = "; ".join(f"site.addsitedir({path!r})" for path in dict.fromkeys(ours))
    (Path(paths["purelib"]) / "seen.pth").write_text(f"import site; {seen}\n", encoding="utf-8")
    return Path(paths["scripts"])
