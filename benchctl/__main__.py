"""Run `python -m benchctl`."""

from benchctl.cli import main

main()
