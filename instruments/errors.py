"""Whose fault it is: the class of an error decides the reaction, so that no caller has to parse a message.

| class             | who is to blame                               | reaction                      | exit status |
|-------------------|-----------------------------------------------|-------------------------------|-------------|
| `UsageError`      | the caller: the input cannot be used          | say so, never retry           | 2           |
| `LinkError`       | the wire: no bytes, or broken ones            | may be retried, then stop     | 3           |
| `InstrumentError` | the instrument said no, or answered nonsense  | never retry blindly, stop     | 3           |
| `SafetyError`     | a limit was passed                            | bring the bench to rest       | 3           |

A message is one line and says what was tried, what was expected, what came, and what to do.
"""


class BenchError(Exception):
    """Something that the operator is told in one line; not to be raised itself."""

    exit_status = 3


class UsageError(BenchError):
    """The input or the call cannot be used as it is."""

    exit_status = 2


class LinkError(BenchError):
    """No answer came over the wire, or a broken one."""


class InstrumentError(BenchError):
    """The instrument refused, reported a fault, or did not do what it acknowledged."""


class SafetyError(BenchError):
    """A limit of the bench was passed or cannot be watched any more."""


class BenchNotReadyError(LinkError):
    """Instruments failed at start-up; all of them are named, each with its reason. Nothing has moved yet.

    The exit status is that of unusable input where one of them cannot be used as it was described.

    Parameters
    ----------
    failures
        Name of the instrument -> what it failed with.
    """

    def __init__(self, failures: dict[str, BenchError]) -> None:
        self.failures = dict(failures)
        if any(isinstance(error, UsageError) for error in self.failures.values()):
            self.exit_status = UsageError.exit_status
        super().__init__("; ".join(f"{name}: {error}" for name, error in self.failures.items()))


def reason(err: OSError) -> str:
    """What the system says, within a line of ours: "permission denied"."""
    return in_line(err.strerror or str(err))


def in_line(text: str) -> str:
    """What another program says, within a line of ours: one line, no full stop, beginning small unless with a name."""
    line = " ".join(text.split()).removesuffix(".")
    return line[:1].lower() + line[1:] if line[1:2].islower() else line
