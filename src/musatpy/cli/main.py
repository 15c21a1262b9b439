"""The `musat` command: its subcommands, loaded when used, and how every error ends (a line, never a traceback)."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import time
import warnings
from typing import Any

import click

import musatpy
from musatpy.cli.messages import complain, complain_of_error, log, read_no_more, remark
from musatpy.cli.options import COMMON, WORDS, LazyGroup
from musatpy.errors import MissingPackageError, MusatError, printable, shortened
from musatpy.memory import limit, take_working_memory

COMMANDS = {
    "example": "musatpy.cli.making:example_command",
    "run": "musatpy.cli.run:run_command",
    "orient": "musatpy.cli.run:orient_command",
    "as11": "musatpy.cli.as11",
    "batch": "musatpy.cli.batches:batch_command",
    "baseline": "musatpy.cli.batches:baseline_command",
    "plot": "musatpy.cli.results:plot_command",
    "check": "musatpy.cli.decks:check_command",
    "card": "musatpy.cli.cards:card_command",
    "tidy": "musatpy.cli.cards:tidy_command",
    "tide": "musatpy.cli.cards:tide_command",
    "simulate": "musatpy.cli.making:simulate_command",
    "explain": "musatpy.cli.results:explain_command",
    "compare": "musatpy.cli.results:compare_command",
    "report": "musatpy.cli.results:report_command",
    "audit": "musatpy.cli.results:audit_command",
    "diff": "musatpy.cli.results:diff_command",
    "convert": "musatpy.cli.making:convert_command",
    "merge": "musatpy.cli.decks:merge_command",
    "extract": "musatpy.cli.decks:extract_command",
    "list": "musatpy.cli.decks:list_command",
    "correct": "musatpy.cli.correct",
    "depth": "musatpy.cli.depth",
    "import": "musatpy.cli.sfm:import_command",
    "export": "musatpy.cli.sfm:export_command",
    "waves": "musatpy.cli.making:waves_command",
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

FAILURE = {"diff": 2, "audit": 2}  # exit status of commands that cannot do their work, 1 for all others
READ_NO_MORE = 141  # exit status where nobody reads the help, that of a shell for SIGPIPE
REPORT_TO = "please report it, with the deck and what 'musat --debug ...' prints"


class Commands(LazyGroup):
    """The commands of the program, and what becomes of their errors."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the command line, which the log has whole."""
        ctx.meta[WORDS] = list(args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; whatever it raises ends as a message and an exit status."""
        start, status = time.monotonic(), 1
        try:
            result = super().invoke(ctx) if ctx.params["debug"] else self._invoke(ctx)
            status = 0
            return result
        except click.exceptions.Exit as ended:
            status = ended.exit_code
            raise
        except click.ClickException as error:
            status = error.exit_code
            log(error.format_message())
            raise
        finally:
            remark(f"status {status}, {time.monotonic() - start:.1f} s")

    def _invoke(self, ctx: click.Context) -> Any:
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
            if isinstance(error, BrokenPipeError):  # of click's own help
                read_no_more(sys.stdout)
                ctx.exit(READ_NO_MORE)
            complain_of_error(error)
            if isinstance(error, MissingPackageError):
                ctx.exit(1)
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


@click.group(cls=Commands, modules=COMMANDS, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(musatpy.__version__, prog_name="musat")
def main(debug: bool) -> None:
    """Compute the aerotriangulation of photographs that show points under water.

    Exit status: 0 converged, accepted or doubtful; 1 a deck or its data cannot be used; 2 wrong command line; 3 not
    converged; 4 rejected (with --strict: or doubtful).
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # names of files and bad cards may hold what the terminal cannot show
            stream.reconfigure(errors="backslashreplace")


main.params += COMMON
