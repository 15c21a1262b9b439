"""Batches run for real: folders of decks, the command in a process of its own, and what has to be true after it."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import chdir, contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from click.testing import Result

from cli import commands
from musatpy.runs import run_deck

ROOT = Path(__file__).parents[2]
ST_THOMAS = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"
STANDARD = ROOT / "fixtures" / "cayman" / "cayman_standard.crd"
MAIN = "from musatpy.cli.main import main; main()"


def decks_in(folder: Path, *, small: int, large: int = 0) -> list[Path]:
    """Return copies of the deck of three photos (some tenths of a second) and of that of ten."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = [(f"small{n}", ST_THOMAS) for n in range(small)] + [(f"large{n}", STANDARD) for n in range(large)]
    return [Path(shutil.copy(source, folder / f"{name}.crd")) for name, source in sources]


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-P", "-c", MAIN, *map(str, arguments)]


def musat(*arguments: object, cwd: Path | None = None, **more) -> subprocess.CompletedProcess[str]:
    ran = subprocess.run(command(*arguments), cwd=cwd, capture_output=True, text=True, timeout=120, **more)
    assert "Traceback" not in ran.stderr
    return ran


@contextmanager
def near() -> Iterator[None]:
    """Have batches run their jobs in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("musatpy.campaign.batch.LocalExecutor", Near)
        yield


def here(*arguments: object, cwd: Path) -> Result:
    """Run the command in this process, and its jobs too."""
    with near(), chdir(cwd):
        return commands.musat(*arguments)


def start(*arguments: object, cwd: Path) -> subprocess.Popen[str]:
    """Start the command in a folder; its workers are found by it."""
    return subprocess.Popen(command(*arguments), cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@cache
def expected(source: Path) -> dict[str, bytes]:
    """Return what a run of a deck leaves, by endings: what stands in it does not depend on the name of the deck."""
    with TemporaryDirectory() as folder:
        result = run_deck(source, folder)
        assert result.listing and result.record
        return {path.suffix: path.read_bytes() for path in (result.listing, result.record)}


def assert_whole(folder: Path) -> set[str]:
    """Every listing and record of a folder is whole; return the names of decks that have one."""
    found = set()
    for path in folder.iterdir():
        if path.name.startswith((".", "musat-batch.")) or path.suffix not in (".lst", ".json"):
            continue
        source = ST_THOMAS if path.name.startswith("small") else STANDARD
        assert path.read_bytes() == expected(source)[path.suffix], path
        found.add(path.stem)
    return found


def leftovers(folder: Path) -> list[str]:
    """Return the hidden files of a folder, besides the ledger."""
    return sorted(
        path.name for path in folder.iterdir() if path.name[0] == "." and path.name != ".musat-batch.jsonl"
    )


def ledger_of(folder: Path) -> list[str]:
    """Return the jobs that the ledger of a folder names in whole lines."""
    path = folder / ".musat-batch.jsonl"
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    return [json.loads(line)["job"] for line in lines]


def summary_of(folder: Path) -> dict:
    return json.loads((folder / "musat-batch.json").read_text())


def processes_in(folder: Path, parent: int | None = None) -> list[int]:
    """Return the pids of processes whose working folder is this one, or of the children of `parent` there."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and os.readlink(entry / "cwd") == str(folder.resolve()):
                ppid = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                if parent in (None, ppid):
                    found.append(int(entry.name))
        except OSError:
            continue  # it has ended, or is none of ours
    return found


def wait_for(condition, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.01)


class Here(Executor):
    """Runs what it is given in this process at once; `fails` says what is not done."""

    def __init__(self, fails: dict[str, Exception] | None = None) -> None:
        self.fails = fails or {}

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        error = self.fails and self.fails.get(args[0].job.deck.stem)
        if error:
            future.set_exception(error)
        else:
            future.set_result(fn(*args, **kwargs))
        return future


class Near(Here):
    """In the place of the executor of processes: decks of some tenths of a second are not worth their start."""

    def __init__(self, processes: int, on_message: object, fds: object = ()) -> None:
        super().__init__()
