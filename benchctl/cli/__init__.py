"""The command line: one short file a verb. What a verb needs is imported when it runs, so that `--help` is quick."""

import sys


def main() -> None:
    """The console script; Ctrl-C while it is being loaded, or as it ends, is no traceback either."""
    try:
        from benchctl.cli.app import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("benchctl: stopped\n")
        sys.exit(130)
