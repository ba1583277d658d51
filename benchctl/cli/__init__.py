"""The command line interface: one short module per verb, imported only when the verb runs, so that `--help` is fast."""

import sys


def main() -> None:
    """Run the console script; Ctrl-C during import or at exit prints no traceback."""
    try:
        from benchctl.cli.app import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("benchctl: stopped\n")
        sys.exit(130)
