"""The `musat` command: its subcommands, loaded when used, and how every error ends (a line, never a traceback)."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import sys
import warnings
from typing import Any

import click

import musatpy
from musatpy.cli.lazy import LazyGroup
from musatpy.cli.messages import complain, complain_of_error
from musatpy.errors import MusatError, printable, shortened
from musatpy.memory import limit, take_working_memory

COMMANDS = {
    "example": "musatpy.cli.example",
    "run": "musatpy.cli.run",
    "orient": "musatpy.cli.orient",
    "as11": "musatpy.cli.as11",
    "batch": "musatpy.cli.batch",
    "baseline": "musatpy.cli.baseline",
    "plot": "musatpy.cli.plot",
    "check": "musatpy.cli.check",
    "card": "musatpy.cli.card",
    "tidy": "musatpy.cli.tidy",
    "tide": "musatpy.cli.tide",
    "simulate": "musatpy.cli.simulate",
    "explain": "musatpy.cli.explain",
    "compare": "musatpy.cli.compare",
    "report": "musatpy.cli.report",
    "audit": "musatpy.cli.audit",
    "diff": "musatpy.cli.diff",
    "convert": "musatpy.cli.convert",
    "merge": "musatpy.cli.merge",
    "extract": "musatpy.cli.extract",
    "list": "musatpy.cli.list",
    "correct": "musatpy.cli.correct",
    "depth": "musatpy.cli.depth",
    "waves": "musatpy.cli.waves",
    "sea": "musatpy.cli.sea",
}
# Before numpy is imported. The matrices of a job are small: threads of the linear algebra library cost more than
# they bring, badly so where several jobs share the cores. Who wants them sets the variable himself.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# A run makes many small objects and no cycles among them: looking for these less often saves some hundredths of it.
gc.set_threshold(100_000)
# What is left when the program ends goes with the process: looking through all of it for cycles once more would
# take a twentieth of a short run.
atexit.register(gc.freeze)

FAILURE = {"diff": 2}  # exit status of commands that cannot do their work, 1 for all others
REPORT_TO = "please report it, with the deck and what 'musat --debug ...' prints"


class Commands(LazyGroup):
    """The commands of the program, and what becomes of their errors."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; whatever it raises ends as a message and an exit status."""
        if ctx.params["debug"]:
            return super().invoke(ctx)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                warnings.filterwarnings("ignore", "Glyph", UserWarning)  # of names with letters that no font has
                if limit() is not None:
                    take_working_memory()
                return super().invoke(ctx)
        except click.ClickException as error:
            vars(error)["message"] = printable(shortened(error.message))  # names of files stand in it
            raise
        except (click.exceptions.Exit, click.Abort):
            raise
        except (OSError, MusatError) as error:
            if isinstance(error, OSError) and error.errno == errno.EPIPE:
                raise  # click ends quietly
            complain_of_error(error)
        except MemoryError:
            complain(_out_of_memory())
        except Exception as error:
            if isinstance(error, ImportError | SystemError) and limit() is not None:  # a library finds no room
                complain(f"{_out_of_memory()}: {error}")
            else:
                complain(f"unexpected {type(error).__name__}: {error}; {REPORT_TO}")
        ctx.exit(FAILURE.get(ctx.invoked_subcommand or "", 1))


def _out_of_memory() -> str:
    """Return what is said where there is no memory, with the limit where one is set."""
    bound = limit()
    return "memory ran out" + ("" if bound is None else f": this process may have {bound >> 20} MB (ulimit -v)")


@click.group(cls=Commands, modules=COMMANDS)
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(musatpy.__version__, prog_name="musat")
def main(debug: bool) -> None:
    """Aerotriangulation of photographs with submerged points, from card decks.

    Exit status: 0 converged, 1 a deck or its data cannot be used, 2 wrong command line, 3 not converged.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # names of files and bad cards may hold what the terminal cannot show
            stream.reconfigure(errors="backslashreplace")
