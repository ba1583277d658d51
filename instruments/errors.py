"""Exceptions of the suite. The class of an error determines the reaction; no caller has to parse a message.

| class             | cause                                         | reaction                      | exit status |
|-------------------|-----------------------------------------------|-------------------------------|-------------|
| `UsageError`      | the caller: the input is invalid              | report it, never retry        | 2           |
| `LinkError`       | the connection: no bytes, or broken ones      | may be retried, then stop     | 3           |
| `InstrumentError` | the instrument refused, or answered nonsense  | never retry blindly, stop     | 3           |
| `SafetyError`     | a limit was exceeded                          | bring the bench to rest       | 3           |

A message is one line: what was attempted, what was expected, what was received, and what to do.
"""


class BenchError(Exception):
    """Base class of errors that are reported to the operator in one line; not raised itself."""

    exit_status = 3


class UsageError(BenchError):
    """The input or the call is invalid."""

    exit_status = 2


class LinkError(BenchError):
    """No answer was received, or a broken one."""


class InstrumentError(BenchError):
    """The instrument refused, reported a fault, or did not do what it acknowledged."""


class SafetyError(BenchError):
    """A limit of the bench was exceeded or can no longer be monitored."""


class BenchNotReadyError(LinkError):
    """Instruments failed at start-up; the message names each one with its reason. Nothing has moved yet.

    The exit status is that of a `UsageError` if one of the failures is one.

    Parameters
    ----------
    failures
        Name of the instrument -> its error.
    """

    def __init__(self, failures: dict[str, BenchError]) -> None:
        self.failures = dict(failures)
        if any(isinstance(error, UsageError) for error in self.failures.values()):
            self.exit_status = UsageError.exit_status
        super().__init__("; ".join(f"{name}: {error}" for name, error in self.failures.items()))


def reason(err: OSError) -> str:
    """Return the system's message, formatted for use within a line: "permission denied"."""
    return in_line(err.strerror or str(err))


def in_line(text: str) -> str:
    """Return another program's message in one line, without full stop, starting in lower case unless with a name."""
    line = " ".join(text.split()).removesuffix(".")
    return line[:1].lower() + line[1:] if line[1:2].islower() else line
