"""The command line. Messages and progress go to stderr, results to stdout; `--json` prints one object.

A command imports what it works with when it runs, so that help and usage errors come at once: its module states
options and help, and everything else is imported inside the function.
"""

from pkm_rig.cli.entry import main

__all__ = ["main"]
