"""Runs tests as they are asked for, each time in a process of its own that has loaded what no mutation changes.

The first line on standard output names the modules of the program that are loaded. A line on standard input is the
file for what tests print and their arguments, with tabs between; their status is a line on standard output.
"""

from __future__ import annotations

import importlib
import os
import sys

import pytest

# Most of what a short test costs is to import these.
LOADED = (
    "click.testing", "hypothesis", "matplotlib.figure", "pyproj", "scipy.interpolate", "scipy.linalg",
    "scipy.optimize", "scipy.sparse.linalg", "scipy.spatial", "scipy.stats",
    "musatpy.adjustment", "musatpy.formats.checks", "musatpy.simulation", "musatpy.json_files",
)  # fmt: skip


def main() -> None:
    for name in LOADED:
        importlib.import_module(name)
    print(*(name for name in sys.modules if name.partition(".")[0] == "musatpy"), flush=True)
    for line in sys.stdin:
        output, *arguments = line.rstrip("\n").split("\t")
        child = os.fork()
        if child == 0:
            printed = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(printed, 1)
            os.dup2(printed, 2)
            status = pytest.main(arguments)
            sys.stdout.flush()
            os._exit(int(status))
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()
