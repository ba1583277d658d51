"""A signed acceptance: QA signs it, and a customer verifies it in another place."""

from __future__ import annotations

import json
import os
import pty
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pypdfium2
import pytest

from benchctl import api
from benchctl.recordings.campaign_manifest import write_manifest
from benchctl.sshsig import NAMESPACE, read_signing_key
from tests.benchctl.cli.processes import without_a_process
from tests.benchctl.cli.test_accept import FAILS, PASSES, SHORT
from tests.benchctl.test_sshsig import key_file, needs_ssh_keygen, never_asked

STATEMENT, SIGNATURE = "acceptance.signed.json", "acceptance.signed.json.sig"
SIGNED = ["acceptance.html", "acceptance.json", "acceptance.pdf", "acceptance.xml", "journal.jsonl"]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a signed campaign `unit`, a recording of another run, keys and limits."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "short.py").write_text(SHORT)
    (folder / "limits.toml").write_text(PASSES)
    key_file(folder / "anna")
    key_file(folder / "boris", "Boris")
    key_file(folder / "locked", passphrase="correct")
    done("run", "short.py", "--bench", "simulated", "--seed", "1", "--out", "unit", folder=folder)
    done("simulate", "short.py", "--seed", "2", "-o", "other.h5", folder=folder)
    done("accept", "unit", "--limits", "limits.toml", "--sign", "anna", folder=folder)
    return folder


@pytest.fixture
def unit(lab: Path, tmp_path: Path) -> Path:
    """A copy of the campaign on the customer's machine, with a list of signers beside it."""
    (tmp_path / "signers").write_text(f"anna@lab.example {(lab / 'anna.pub').read_text()}")
    return Path(shutil.copytree(lab / "unit", tmp_path / "delivered"))


def done(*arguments: str, folder: Path) -> None:
    ran = without_a_process(*arguments, "--quiet", folder=folder)
    assert ran.returncode == 0, ran.stderr


def verified(path: Path, *arguments: str | Path) -> tuple[int, dict[str, Any], list[str]]:
    """Exit status, JSON, and the lines on stderr without the name of what is verified."""
    ran = without_a_process("verify", path, *arguments, "--json", "-")
    return ran.returncode, json.loads(ran.stdout), ran.stderr.replace(f"benchctl: {path}: ", "").splitlines()


def change_a_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_verify_says_by_whom_a_copied_campaign_was_signed(lab: Path, unit: Path) -> None:
    key = read_signing_key(lab / "anna", never_asked).public
    ran = without_a_process("verify", unit)
    assert (ran.returncode, ran.stderr) == (0, "")
    unchanged, signed, trust = ran.stdout.splitlines()
    assert unchanged.startswith(f"{unit}: nothing changed since it was written; campaign digest ")
    assert signed.startswith(f"signed by Anna Petrova (QA), key {key.fingerprint}, 20")
    assert signed.endswith(" UTC: PASS, SIM-0001")
    assert trust == "the signature matches; whose key it is was not checked: --signers FILE lists the accepted keys"
    status, told, _ = verified(unit)
    assert status == 0
    assert told["signature"].pop("signed_utc").endswith("+00:00")
    assert told["signature"] == {
        "name": "Anna Petrova (QA)",
        "fingerprint": key.fingerprint,
        "unit": "SIM-0001",
        "verdict": "PASS",
        "accepted_by": None,
    }


def test_the_statement_covers_the_report_the_recording_and_the_manifest(unit: Path) -> None:
    statement = json.loads((unit / STATEMENT).read_text(encoding="utf-8"))
    manifest = json.loads((unit / "manifest.json").read_text())["files"]
    assert list(statement["files"]) == SIGNED
    assert all(statement["files"][name] == manifest[name] for name in SIGNED)
    assert statement["recording"] == {"name": "unit", "digest": manifest["recording.h5"]["digest"]}
    assert {STATEMENT, SIGNATURE} <= manifest.keys()


def test_the_report_names_the_signer_and_the_key(lab: Path, unit: Path) -> None:
    fingerprint = read_signing_key(lab / "anna", never_asked).public.fingerprint
    page = (unit / "acceptance.html").read_text(encoding="utf-8")
    assert f"Signed electronically by Anna Petrova (QA), Ed25519 key {fingerprint}: see {SIGNATURE}" in page
    with pypdfium2.PdfDocument(unit / "acceptance.pdf") as document:
        text = "".join("".join(page.get_textpage().get_text_bounded().split()) for page in document)
    assert fingerprint in text


@needs_ssh_keygen
def test_ssh_keygen_verifies_the_signature(unit: Path) -> None:
    who = ["-f", str(unit.parent / "signers"), "-I", "anna@lab.example", "-n", NAMESPACE]
    ran = subprocess.run(
        ["ssh-keygen", "-Y", "verify", *who, "-s", str(unit / SIGNATURE)],
        input=(unit / STATEMENT).read_bytes(),
        capture_output=True,
        timeout=60,
    )
    assert ran.returncode == 0, ran.stderr


def test_a_list_of_signers_vouches_for_its_keys_only(lab: Path, unit: Path) -> None:
    signers = unit.parent / "signers"
    status, told, _ = verified(unit, "--signers", signers)
    assert (status, told["signature"]["name"]) == (0, "anna@lab.example")
    assert told["signature"]["accepted_by"] == str(signers)
    assert f"the key is listed in {signers}" in without_a_process("verify", unit, "--signers", signers).stdout
    fingerprint = told["signature"]["fingerprint"]
    signers.write_text(f"boris@lab.example {(lab / 'boris.pub').read_text()}")
    status, told, err = verified(unit, "--signers", signers)
    assert status == 1
    assert len(err) == 1
    assert err[0].startswith(f"{SIGNATURE}: was made with key {fingerprint} on 20")
    assert err[0].endswith(f", which {signers} does not accept")
    assert told["error"] == told["problems"][0] == err[0]


def test_a_list_of_signers_asks_for_a_signature(lab: Path, tmp_path: Path) -> None:
    (tmp_path / "signers").write_text("")
    assert verified(lab / "other.h5")[0] == 0
    status, told, err = verified(lab / "other.h5", "--signers", tmp_path / "signers")
    assert (status, told["signature"]) == (1, None)
    assert err == [f"{SIGNATURE}: is not there: the acceptance is not signed"]


@pytest.mark.parametrize("name", SIGNED)
def test_a_byte_that_was_changed_after_signing_is_one_line(unit: Path, name: str) -> None:
    change_a_byte(unit / name)
    assert verified(unit)[::2] == (1, [f"{name}: changed since it was signed"])
    write_manifest(unit)  # as whoever wants to conceal it would
    assert verified(unit)[::2] == (1, [f"{name}: changed since it was signed"])


def test_a_changed_or_exchanged_recording_is_found(lab: Path, unit: Path) -> None:
    content = (unit / "recording.h5").read_bytes()
    change_a_byte(unit / "recording.h5")
    assert verified(unit)[0] == 1
    (unit / "recording.h5").write_bytes(content)
    assert verified(unit)[0] == 0
    shutil.copy(lab / "other.h5", unit / "recording.h5")
    write_manifest(unit)
    status, _, err = verified(unit)
    assert status == 1
    assert len(err) == 1
    assert err[0].startswith("recording: is not the one that was signed: its digest is ")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("acceptance.pdf", "acceptance.pdf: is not there, and was signed"),
        (STATEMENT, f"{STATEMENT}: was deleted, the signature cannot be checked"),
        (SIGNATURE, f"{SIGNATURE}: was deleted, the signature cannot be checked"),
    ],
)
def test_a_missing_file_is_named(unit: Path, name: str, says: str) -> None:
    (unit / name).unlink()
    assert verified(unit)[::2] == (1, [says])


def test_a_changed_statement_or_signature_does_not_match(unit: Path) -> None:
    statement = (unit / STATEMENT).read_text(encoding="utf-8")
    (unit / STATEMENT).write_text(statement.replace('"PASS"', '"FAIL"'), encoding="utf-8")
    write_manifest(unit)
    status, told, err = verified(unit)
    assert (status, told["signature"]) == (1, None)
    assert len(err) == 1
    assert err[0].startswith(f"{SIGNATURE}: does not match: what it signs, or the signature, was changed after signing")


def test_a_signature_by_another_key_than_the_stated_one_is_refused(lab: Path, unit: Path) -> None:
    boris = read_signing_key(lab / "boris", never_asked)
    (unit / SIGNATURE).write_text(boris.sign((unit / STATEMENT).read_bytes()))
    write_manifest(unit)
    says = f"{SIGNATURE}: is by {boris.public.fingerprint}, not by the key that {STATEMENT} names"
    assert verified(unit)[::2] == (1, [says])


def test_the_folder_of_a_report_is_verified_alone(lab: Path, unit: Path, tmp_path: Path) -> None:
    report = tmp_path / "report"
    done("accept", str(unit), "--limits", "limits.toml", "--sign", "anna", "--out", str(report), folder=lab)
    ran = without_a_process("verify", report)
    assert ran.returncode == 0
    assert ran.stdout.startswith(f"{report}: no signed file changed; the recording delivered is elsewhere, not checked")
    change_a_byte(report / "acceptance.pdf")
    assert verified(report)[::2] == (1, ["acceptance.pdf: changed since it was signed"])


def test_a_report_beside_a_recording_is_signed_with_it(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = Path(shutil.copy(lab / "other.h5", tmp_path / "run.h5"))
    (tmp_path / "limits.toml").write_text(FAILS)  # a report of a failure is signed as well
    monkeypatch.setenv("BENCHCTL_PASSPHRASE", "correct")
    accepted = api.accept(recording, tmp_path / "limits.toml", out=tmp_path / "run.acceptance", sign=lab / "locked")
    assert list(accepted.files)[-2:] == ["statement", "signature"]
    status, told, _ = verified(recording)
    assert (status, told["signature"]["verdict"]) == (0, "FAIL")
    (tmp_path / "run.h5").write_bytes((lab / "unit" / "recording.h5").read_bytes())
    assert verified(recording)[0] == 1


def test_what_cannot_be_signed_is_refused_before_a_file_is_written(lab: Path, unit: Path, tmp_path: Path) -> None:
    def refused(*arguments: str | Path) -> str:
        ran = without_a_process("accept", *arguments, "--limits", lab / "limits.toml", folder=tmp_path)
        assert ran.returncode == 2
        assert len(ran.stderr.splitlines()) == 1
        return ran.stderr

    before = {path: path.read_bytes() for path in unit.iterdir()}
    assert "nokey: cannot be read" in refused(unit, "--sign", "nokey")
    assert "locked: needs its passphrase, there is no terminal" in refused(unit, "--sign", lab / "locked")
    assert {path: path.read_bytes() for path in unit.iterdir()} == before
    (unit / "notes.txt").write_text("by hand")
    assert "differs from its manifest, and so is not signed: notes.txt: was added" in refused(
        unit, "--sign", lab / "anna"
    )
    done("export", str(lab / "other.h5"), "--to", "open", "-o", "theirs", folder=tmp_path)
    assert "has no digest that could be signed" in refused("theirs", "--sign", lab / "anna")
    assert not (tmp_path / "theirs.acceptance").exists()
    with pytest.raises(api.UsageError, match="sign: there is no report to sign"):
        api.accept(unit, lab / "limits.toml", sign=lab / "anna")


@pytest.mark.parametrize("passphrase", ["correct", "incorrect"])
@pytest.mark.slow
def test_the_passphrase_is_asked_for_at_a_terminal(lab: Path, tmp_path: Path, passphrase: str) -> None:
    ours, theirs = pty.openpty()
    command = ["accept", "other.h5", "--limits", "limits.toml", "--out", str(tmp_path / "report"), "--quiet"]
    with subprocess.Popen(
        [sys.executable, "-m", "benchctl", *command, "--sign", "locked"],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        cwd=lab,
        start_new_session=True,
    ) as process:
        os.close(theirs)
        said = ""
        while "Passphrase of the key: " not in said:
            said += os.read(ours, 1000).decode()
        os.write(ours, f"{passphrase}\n".encode())
        said = read_to_the_end(lambda: os.read(ours, 1000))
        status = process.wait(timeout=100)
    os.close(ours)
    assert passphrase not in said
    assert status == (0 if passphrase == "correct" else 2)
    assert (tmp_path / "report" / SIGNATURE).exists() == (passphrase == "correct")


def read_to_the_end(read: Callable[[], bytes]) -> str:
    found = b""
    try:
        while part := read():
            found += part
    except OSError:  # Linux' end of a terminal
        pass
    return found.decode()
