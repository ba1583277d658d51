"""Sign and check bytes with OpenSSH Ed25519 keys, in the format of `ssh-keygen -Y sign`.

The format is described in PROTOCOL.sshsig of OpenSSH, the list of accepted keys in ALLOWED SIGNERS of ssh-keygen(1).
`ssh-keygen -Y verify -n benchctl-acceptance` accepts what `SigningKey.sign` returns, and `signed_by` what
`ssh-keygen -Y sign -n benchctl-acceptance` writes.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from benchctl.limits import read_whole, shown
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

NAMESPACE = "benchctl-acceptance"
"""The purpose that is part of every signature; one made for another purpose, such as a commit, is not accepted."""

_MAGIC = b"SSHSIG"
_VERSION = 1
_KIND = b"ssh-ed25519"
_HASHES = ("sha512", "sha256")
_BEGIN, _END = "-----BEGIN SSH SIGNATURE-----", "-----END SSH SIGNATURE-----"
_LINE = 70
_MOST_KEY_BYTES = 1 << 16
_EXPECTED = "expected a private Ed25519 key of OpenSSH; make one with ssh-keygen -t ed25519 -C NAME -f FILE"


@dataclass(frozen=True, slots=True)
class PublicKey:
    """An Ed25519 key that checks signatures; `blob` is its encoding of RFC 8709. `str` gives `ssh-ed25519 AAAA…`."""

    blob: bytes

    def __str__(self) -> str:
        return f"{_KIND.decode()} {base64.b64encode(self.blob).decode()}"

    @property
    def fingerprint(self) -> str:
        """The SHA-256 of the key, as `ssh-keygen -l` prints it."""
        return "SHA256:" + base64.b64encode(hashlib.sha256(self.blob).digest()).decode().rstrip("=")


@dataclass(frozen=True, slots=True)
class SigningKey:
    """A private key, with the name of its owner."""

    name: str
    public: PublicKey
    _private: Ed25519PrivateKey

    def sign(self, message: bytes) -> str:
        """Return the signature of a message, in the armoured form of OpenSSH."""
        signature = self._private.sign(_signed_data(message, _HASHES[0]))
        fields = (self.public.blob, NAMESPACE.encode(), b"", _HASHES[0].encode(), _strings(_KIND, signature))
        text = base64.b64encode(_MAGIC + _VERSION.to_bytes(4, "big") + _strings(*fields)).decode()
        lines = [text[start : start + _LINE] for start in range(0, len(text), _LINE)]
        return "\n".join([_BEGIN, *lines, _END, ""])


def read_signing_key(path: Path, passphrase: Callable[[], str]) -> SigningKey:
    """Read an OpenSSH Ed25519 key and, from PATH.pub next to it, its comment, which is the name of its owner.

    `passphrase` is called only if the key has one.

    Raises
    ------
    UsageError
        If a file cannot be read or is of another kind, the passphrase is wrong, or the two are not of one key.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    private = _private_key(path, passphrase)
    if not isinstance(private, Ed25519PrivateKey):
        raise UsageError(f"key {path}: {_EXPECTED}")
    line = private.public_key().public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH)
    public = PublicKey(base64.b64decode(line.split()[1]))
    return SigningKey(_name_of(path, public), public, private)


def _private_key(path: Path, passphrase: Callable[[], str]) -> object:
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.serialization import load_ssh_private_key

    content = read_whole(path, _MOST_KEY_BYTES, "key ")
    try:
        return load_ssh_private_key(content, None)
    except TypeError:  # the documented error for a missing passphrase
        password = passphrase().encode()
    except (ValueError, UnsupportedAlgorithm) as err:
        raise UsageError(f"key {path}: {_EXPECTED}") from err
    try:
        return load_ssh_private_key(content, password)
    except (ValueError, TypeError) as err:  # TypeError: an empty passphrase
        raise UsageError(f"key {path}: the passphrase does not open it; enter it again") from err


def _name_of(path: Path, public: PublicKey) -> str:
    """Return the comment of PATH.pub; the private file has it too, but encrypted, and cryptography skips it."""
    public_file = path.with_name(f"{path.name}.pub")
    if not public_file.exists():
        raise UsageError(
            f"key {public_file}: is not there, and its comment names the signer; "
            f"make it with ssh-keygen -y -f {path} > {public_file}"
        )
    content = read_whole(public_file, _MOST_KEY_BYTES, "key ").decode("utf-8", errors="replace")
    fields = content.strip().split(maxsplit=2)
    if " ".join(fields[:2]) != str(public):
        raise UsageError(
            f"key {public_file}: is not the public half of {path}; make it with ssh-keygen -y -f {path} > {public_file}"
        )
    if len(fields) < 3:
        raise UsageError(
            f"key {public_file}: has no comment, which names the signer; write one with ssh-keygen -c -C NAME -f {path}"
        )
    return fields[2]


def signed_by(message: bytes, armoured: str) -> PublicKey:
    """Return the key whose signature of the message this is.

    Raises
    ------
    UsageError
        If it is no signature of this format, purpose or kind of key, or one of another message or by another key. The
        text is worded to follow the name of the file.
    """
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        text = armoured.strip().removeprefix(_BEGIN).removesuffix(_END)
        blob = base64.b64decode("".join(text.split()), validate=True)
        if not blob.startswith(_MAGIC + _VERSION.to_bytes(4, "big")):
            raise ValueError("another format")
        public, namespace, _, algorithm, signature = _split(blob[len(_MAGIC) + 4 :])
        (key_kind, key), (kind, raw) = _split(public), _split(signature)
        if not key_kind == kind == _KIND or algorithm.decode() not in _HASHES:
            raise ValueError("another kind of key or hash")
        checker = Ed25519PublicKey.from_public_bytes(key)
    except ValueError as err:
        raise UsageError(
            "expected a signature by an Ed25519 key of OpenSSH; it is of another kind, or was changed"
        ) from err
    if namespace != NAMESPACE.encode():
        raise UsageError(f"was made for {shown(namespace.decode(errors='replace'))}, expected {NAMESPACE!r}")
    try:
        checker.verify(raw, _signed_data(message, algorithm.decode()))
    except InvalidSignature as err:
        raise UsageError(
            "does not match: what it signs, or the signature, was changed after signing; take both from the signer"
        ) from err
    return PublicKey(public)


def _signed_data(message: bytes, algorithm: str) -> bytes:
    digest = hashlib.new(algorithm, message).digest()
    return _MAGIC + _strings(NAMESPACE.encode(), b"", algorithm.encode(), digest)


def _strings(*values: bytes) -> bytes:
    """Return values as strings of the SSH protocol: the length in four bytes, then the content."""
    return b"".join(len(value).to_bytes(4, "big") + value for value in values)


def _split(data: bytes) -> list[bytes]:
    """Return the strings of which the data consist; raises `ValueError` if they do not."""
    found = []
    while data:
        length = int.from_bytes(data[:4], "big")
        if len(data) < 4 + length:
            raise ValueError("ends within a string")
        found.append(data[4 : 4 + length])
        data = data[4 + length :]
    return found


_FIELD = re.compile(r'(?:"[^"]*"|[^\s"])+')
_OPTION = re.compile(r'([\w-]+)(?:="([^"]*)")?(?:,|$)')
_KEY_KINDS = re.compile(r"(ssh|ecdsa|sk)-\S+")
_DATES = {8: "%Y%m%d", 12: "%Y%m%d%H%M", 14: "%Y%m%d%H%M%S"}


def accepted_name(signers: Path, key: PublicKey, when: datetime) -> str | None:
    """Return the name that a list of allowed signers gives to a key at a date; None if it does not accept the key.

    Raises
    ------
    UsageError
        If the list cannot be read, or has a line that is not understood.
    """
    text = read_whole(signers, _MOST_KEY_BYTES << 4, "signers ").decode("utf-8", errors="replace")
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            name, options, listed = _allowed(line)
            accepted = listed == str(key) and _allow(options, when)
        except ValueError as err:
            raise UsageError(
                f"signers {signers}, line {number}: expected NAME [OPTIONS] ssh-ed25519 KEY, got {shown(line)}"
            ) from err
        if accepted:
            return name
    return None


def _allowed(line: str) -> tuple[str, dict[str, str], str]:
    """Return name, options and key of a line."""
    name, *rest = _FIELD.findall(line)
    options = {} if rest and _KEY_KINDS.fullmatch(rest[0]) else dict(_options(rest.pop(0) if rest else ""))
    if len(rest) < 2 or not _KEY_KINDS.fullmatch(rest[0]):
        raise ValueError("no key")
    return name.strip('"'), options, " ".join(rest[:2])


def _options(text: str) -> Iterator[tuple[str, str]]:
    place = 0
    while place < len(text):
        found = _OPTION.match(text, place)
        if found is None or found[1].lower() not in ("namespaces", "valid-after", "valid-before", "cert-authority"):
            raise ValueError("unknown option")
        yield found[1].lower(), found[2] or ""
        place = found.end()


def _allow(options: dict[str, str], when: datetime) -> bool:
    """Return whether a line's options accept a signature of this purpose and date; certificates are not supported."""
    purposes = options.get("namespaces", NAMESPACE).split(",")
    return (
        "cert-authority" not in options
        and any(fnmatchcase(NAMESPACE, purpose) for purpose in purposes)
        and ("valid-after" not in options or when >= _date(options["valid-after"]))
        and ("valid-before" not in options or when <= _date(options["valid-before"]))
    )


def _date(text: str) -> datetime:
    """Return a date as ssh-keygen reads it: local time, or UTC with a Z."""
    digits = text.removesuffix("Z")
    date = datetime.strptime(digits, _DATES.get(len(digits), ""))
    return date.replace(tzinfo=UTC) if text.endswith("Z") else date.astimezone()
