"""Archives of campaigns, also from people who mean ill."""

from __future__ import annotations

import gzip
import io
import random
import tarfile
import tempfile
import zipfile
from pathlib import Path

import pytest

from benchctl.history.archives import unpacked
from benchctl.history.history import history_of
from benchctl_instruments.errors import UsageError
from tests.benchctl.history.made_history import campaign, figure


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(2):
        place = campaign(tmp_path / "all", number=number, K0=0.05 + number)
        (place / "report.html").write_text("left where it is")
    return tmp_path / "all"


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where archives are unpacked; nothing may be left there."""
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    return place


def _zip(path: Path, members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def _tar(path: Path, members: list[tuple[tarfile.TarInfo, bytes]], mode: str = "w") -> Path:
    with tarfile.open(path, mode) as archive:  # type: ignore[call-overload]
        for info, content in members:
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


def _refused(path: Path) -> str:
    with pytest.raises(UsageError) as refused, unpacked(path):
        pass
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(f"{path}: ")
    return str(refused.value)


@pytest.mark.parametrize("name", ["all.zip", "all.tar", "all.tar.gz", "all.tgz"])
def test_an_archive_says_what_its_folder_says(folder: Path, name: str, temporary: Path) -> None:
    path = folder.parent / name
    if name.endswith("zip"):
        files = {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*") if one.is_file()}
        _zip(path, files, compression=zipfile.ZIP_DEFLATED)
    else:
        with tarfile.open(path, "w" if name.endswith("tar") else "w:gz") as archive:
            archive.add(folder, arcname=".")
    with unpacked(path) as place:
        assert sorted(one.name for one in place.rglob("*") if one.is_file()) == [
            *["coefficients.json"] * 2,
            *["recording.h5"] * 2,
        ]
        history = history_of(place, name, print, kept=False)
    assert [point.value for point in figure(history).series.points] == [0.05, 1.05]
    assert history.index is None
    assert history.problems == ()
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    "name", ["/etc/recording.h5", "../recording.h5", "a/../../recording.h5", "C:/recording.h5", "a\\..\\recording.h5"]
)
@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_a_path_out_of_the_archive_is_refused(tmp_path: Path, temporary: Path, name: str, kind: str) -> None:
    path = tmp_path / f"bad.{kind}"
    if kind == "zip":
        _zip(path, {name: b"x"})
    else:
        _tar(path, [(tarfile.TarInfo(name), b"x")])
    assert "leads out of the archive" in _refused(path)
    assert list(temporary.iterdir()) == []
    assert not (tmp_path / "recording.h5").exists()


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE])
def test_a_link_or_a_device_in_place_of_a_recording_is_refused(tmp_path: Path, kind: bytes) -> None:
    info = tarfile.TarInfo("recording.h5")
    info.type, info.linkname = kind, "/etc/passwd"
    assert "is no plain file" in _refused(_tar(tmp_path / "bad.tar", [(info, b"")]))


def test_a_zip_bomb_is_refused_before_it_fills_the_disk(tmp_path: Path, temporary: Path) -> None:
    path = _zip(tmp_path / "bomb.zip", {"recording.h5": bytes(200 << 20)}, compression=zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 300_000
    assert "unpacks to more than" in _refused(path)
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("member", ["recording.h5", "unwanted.bin"])
def test_a_tar_bomb_is_refused_also_in_members_that_nobody_wants(tmp_path: Path, member: str) -> None:
    path = _tar(
        tmp_path / "bomb.tar.gz", [(tarfile.TarInfo(member), bytes(200 << 20)), (tarfile.TarInfo("end"), b"")], "w:gz"
    )
    assert "unpacks to more than" in _refused(path)


def test_a_header_that_claims_gigabytes_is_refused(tmp_path: Path) -> None:
    info = tarfile.TarInfo("recording.h5")
    info.size = 1 << 40
    (tmp_path / "bad.tar").write_bytes(info.tobuf() + bytes(10_240))
    assert "unpacks to more than" in _refused(tmp_path / "bad.tar")


@pytest.mark.parametrize("name", ["cut.zip", "cut.tar.gz", "spoilt.zip", "text.zip", "nothing.tar", "a.7z"])
def test_what_is_no_whole_archive_is_one_clear_line(folder: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    content = (folder / "000_SN-1" / "recording.h5").read_bytes()
    if name == "cut.tar.gz":
        _tar(path, [(tarfile.TarInfo("recording.h5"), content)], "w:gz")
        path.write_bytes(path.read_bytes()[:-3000])
    elif name in ("cut.zip", "spoilt.zip"):
        whole = bytearray(_zip(path, {"recording.h5": content}).read_bytes())
        whole[2000] ^= 1
        path.write_bytes(whole if name == "spoilt.zip" else whole[:-60])
    else:
        path.write_bytes({"text.zip": b"PK no zip", "nothing.tar": b"", "a.7z": b"7z\xbc\xaf\x27\x1c"}[name])
    line = _refused(path)
    assert ("is no folder and no archive" if name == "a.7z" else "cannot be unpacked: ") in line


def test_random_damage_ends_in_words(folder: Path, tmp_path: Path) -> None:
    chance = random.Random(1)
    files = {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*.json")}
    packed = _zip(tmp_path / "a.zip", files, compression=zipfile.ZIP_DEFLATED).read_bytes()
    tar = _tar(tmp_path / "a.tar", [(tarfile.TarInfo(name), content) for name, content in files.items()]).read_bytes()
    for number in range(300):
        source, suffix = ((packed, "zip"), (tar, "tar"), (gzip.compress(tar), "tar.gz"))[number % 3]
        spoilt = bytearray(source)
        for _ in range(chance.randint(1, 8)):
            spoilt[chance.randrange(len(spoilt))] = chance.randrange(256)
        path = tmp_path / f"spoilt.{suffix}"
        path.write_bytes(spoilt)
        try:
            with unpacked(path):
                pass
        except UsageError as err:
            assert "\n" not in str(err)  # noqa: PT017 - it may also be read
