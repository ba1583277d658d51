"""Signatures by OpenSSH keys: ours are checked by ssh-keygen, those of ssh-keygen by us."""

from __future__ import annotations

import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from benchctl.sshsig import NAMESPACE, SigningKey, accepted_name, read_signing_key, signed_by
from benchctl_instruments.errors import UsageError

MESSAGE = b"unit SN-17 passes\n"
WHEN = datetime(2026, 11, 27, 16, 0, tzinfo=UTC)

needs_ssh_keygen = pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="ssh-keygen is not installed")


def key_file(path: Path, comment: str = "Anna Petrova (QA)", passphrase: str = "") -> Path:
    """Write a new key and its public half, as `ssh-keygen -t ed25519` does."""
    private = Ed25519PrivateKey.generate()
    encryption = BestAvailableEncryption(passphrase.encode()) if passphrase else NoEncryption()
    path.write_bytes(private.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, encryption))
    path.chmod(0o600)
    public = private.public_key().public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).decode()
    path.with_name(f"{path.name}.pub").write_text(f"{public} {comment}\n", encoding="utf-8")
    return path


def never_asked() -> str:
    raise AssertionError("a key without a passphrase asks for none")


def ssh_keygen(*arguments: str | Path, message: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(["ssh-keygen", *map(str, arguments)], input=message, capture_output=True, timeout=60)


@pytest.fixture
def key(tmp_path: Path) -> SigningKey:
    return read_signing_key(key_file(tmp_path / "anna"), never_asked)


def test_a_signature_is_by_its_key_and_of_its_message_only(key: SigningKey) -> None:
    signature = key.sign(MESSAGE)
    assert signed_by(MESSAGE, signature) == key.public
    with pytest.raises(UsageError, match="does not match"):
        signed_by(MESSAGE + b" ", signature)


def test_a_changed_character_of_a_signature_is_found(key: SigningKey) -> None:
    signature = key.sign(MESSAGE)
    changed = [
        signature[:place] + ("A" if signature[place] != "A" else "B") + signature[place + 1 :]
        for place in range(len(signature))
        if signature[place] not in "\n="
    ]
    accepted = 0
    for one in changed:
        try:
            accepted += signed_by(MESSAGE, one) == key.public
        except UsageError:
            continue
    assert len(changed) > 300
    assert accepted == 0


@needs_ssh_keygen
def test_ssh_keygen_accepts_our_signature_and_prints_our_fingerprint(key: SigningKey, tmp_path: Path) -> None:
    (tmp_path / "m.sig").write_text(key.sign(MESSAGE))
    (tmp_path / "signers").write_text(f"anna@lab.example {key.public}\n")
    signature = ("-n", NAMESPACE, "-s", tmp_path / "m.sig")
    alone = ssh_keygen("-Y", "check-novalidate", *signature, message=MESSAGE)
    listed = ("-f", tmp_path / "signers", "-I", "anna@lab.example")
    vouched = ssh_keygen("-Y", "verify", *listed, *signature, message=MESSAGE)
    assert (alone.returncode, vouched.returncode) == (0, 0)
    assert key.public.fingerprint in alone.stdout.decode()
    assert key.public.fingerprint in ssh_keygen("-l", "-f", tmp_path / "anna.pub").stdout.decode()
    assert ssh_keygen("-Y", "check-novalidate", *signature, message=MESSAGE + b" ").returncode != 0


@needs_ssh_keygen
@pytest.mark.parametrize("algorithm", ["sha256", "sha512"])
def test_a_signature_by_ssh_keygen_is_accepted(tmp_path: Path, algorithm: str) -> None:
    ssh_keygen("-q", "-t", "ed25519", "-C", "Anna Petrova (QA)", "-N", "", "-f", tmp_path / "anna")
    (tmp_path / "m").write_bytes(MESSAGE)
    ssh_keygen("-Y", "sign", "-O", f"hashalg={algorithm}", "-n", NAMESPACE, "-f", tmp_path / "anna", tmp_path / "m")
    key = read_signing_key(tmp_path / "anna", never_asked)
    assert key.name == "Anna Petrova (QA)"
    assert signed_by(MESSAGE, (tmp_path / "m.sig").read_text()) == key.public


@needs_ssh_keygen
def test_a_signature_for_another_purpose_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m").write_bytes(MESSAGE)
    for kind, purpose, says in (
        ("ed25519", "git", "was made for 'git', expected 'benchctl-acceptance'"),
        ("ecdsa", NAMESPACE, "expected a signature by an Ed25519 key"),
    ):
        ssh_keygen("-q", "-t", kind, "-N", "", "-f", tmp_path / kind)
        (tmp_path / "m.sig").unlink(missing_ok=True)
        ssh_keygen("-Y", "sign", "-n", purpose, "-f", tmp_path / kind, tmp_path / "m")
        with pytest.raises(UsageError, match=says):
            signed_by(MESSAGE, (tmp_path / "m.sig").read_text())


def test_a_key_with_a_passphrase_is_opened_by_it_alone(tmp_path: Path) -> None:
    path = key_file(tmp_path / "anna", passphrase="correct")
    key = read_signing_key(path, lambda: "correct")
    assert signed_by(MESSAGE, key.sign(MESSAGE)) == key.public
    for wrong in ("incorrect", ""):
        with pytest.raises(UsageError, match="the passphrase does not open it"):
            read_signing_key(path, lambda passphrase=wrong: passphrase)


def test_a_key_that_cannot_sign_is_refused_in_a_line(tmp_path: Path) -> None:
    other = ec.generate_private_key(ec.SECP256R1())
    (tmp_path / "ecdsa").write_bytes(other.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption()))
    (tmp_path / "text").write_text("no key")
    key_file(tmp_path / "bare", comment="")
    key_file(tmp_path / "alone").with_name("alone.pub").unlink()
    key_file(tmp_path / "mixed").with_name("mixed.pub").write_bytes((tmp_path / "bare.pub").read_bytes())
    for name, says in (
        ("none", "none: cannot be read"),
        ("ecdsa", "ecdsa: expected a private Ed25519 key of OpenSSH; make one with ssh-keygen -t ed25519"),
        ("text", "text: expected a private Ed25519 key of OpenSSH"),
        ("bare", "bare.pub: has no comment"),
        ("alone", "alone.pub: is not there"),
        ("mixed", "mixed.pub: is not the public half of"),
    ):
        with pytest.raises(UsageError, match=says) as caught:
            read_signing_key(tmp_path / name, never_asked)
        assert "\n" not in str(caught.value)


listed = pytest.mark.parametrize(
    ("before", "name"),
    [
        ("anna@lab.example", "anna@lab.example"),
        ('"Anna Petrova"', "Anna Petrova"),
        ('anna namespaces="git,benchctl-*"', "anna"),
        ('anna namespaces="git"', None),
        ('anna valid-after="20261127160000Z",valid-before="20261128Z"', "anna"),
        ('anna valid-after="202611271601Z"', None),
        ('anna valid-before="20261127160000Z"', "anna"),
        ('anna valid-before="20261127155959Z"', None),
        ("anna cert-authority", None),
    ],
)


def signers_file(tmp_path: Path, before: str, key: SigningKey) -> Path:
    other = read_signing_key(key_file(tmp_path / "other"), never_asked)
    lines = ["# QA", "", f"other@lab.example {other.public} Other's", f"{before} {key.public} Anna's key", ""]
    (tmp_path / "signers").write_text("\n".join(lines))
    return tmp_path / "signers"


@listed
def test_a_list_of_signers_accepts_a_key_by_its_options(
    key: SigningKey, tmp_path: Path, before: str, name: str | None
) -> None:
    assert accepted_name(signers_file(tmp_path, before, key), key.public, WHEN) == name


@needs_ssh_keygen
@listed
def test_ssh_keygen_accepts_the_same_keys_by_the_same_list(
    key: SigningKey, tmp_path: Path, before: str, name: str | None
) -> None:
    (tmp_path / "m.sig").write_text(key.sign(MESSAGE))
    who = ("-f", signers_file(tmp_path, before, key), "-I", name or "anna")
    what = ("-O", f"verify-time={WHEN:%Y%m%d%H%M%SZ}", "-n", NAMESPACE, "-s", tmp_path / "m.sig")
    ran = ssh_keygen("-Y", "verify", *who, *what, message=MESSAGE)
    assert (ran.returncode == 0) == (name is not None), ran.stderr


@pytest.mark.parametrize("line", ["anna", "anna ssh-ed25519", 'anna maybe="1" KEY', 'anna valid-before="tomorrow" KEY'])
def test_a_line_that_is_not_understood_is_named(key: SigningKey, tmp_path: Path, line: str) -> None:
    (tmp_path / "signers").write_text("# QA\n" + line.replace("KEY", str(key.public)))
    with pytest.raises(UsageError, match=r"signers, line 2: expected NAME \[OPTIONS\] ssh-ed25519 KEY"):
        accepted_name(tmp_path / "signers", key.public, WHEN)
