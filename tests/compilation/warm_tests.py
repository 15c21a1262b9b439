"""Runs tests as they are asked for, each time in a process of its own that has loaded all but the program already.

A line on standard input is the file for what they print and their arguments, with tabs between; their status is a
line on standard output.
"""

from __future__ import annotations

import os
import sys

# What the program and its tests import besides: half of what a short test costs.
import click.testing  # noqa: F401
import hypothesis  # noqa: F401
import matplotlib.figure  # noqa: F401
import pyproj  # noqa: F401
import pytest
import scipy.interpolate
import scipy.linalg
import scipy.optimize
import scipy.sparse.linalg
import scipy.spatial
import scipy.stats  # noqa: F401


def main() -> None:
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
