"""The examples of the manual, and those of options.md, run by the version that is on PYTHONPATH.

A page has a folder of its own, with the fixtures, as in `tests/docs`. What every command says and how it ends goes
to a file of its number; the files that the commands leave stay beside them.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

NOT_TEXT = (".gpkg", ".laz")  # with the time of writing, or packed: their GeoJSON and LAS are held
_BLOCK = re.compile(r"^```console\n(.*?)^```", re.DOTALL | re.MULTILINE)
_COMMAND = re.compile(r"^\$ (.*)$", re.MULTILINE)
_TIMED = re.compile(r"\b\d+(\.\d+)? (s|min|ms)\b")
_LASTED = re.compile(r'("(?:seconds|started|finished|elapsed)": )[^,\n}]+')


def copied(root: Path, out: Path) -> None:
    """Copy the pages of a checkout and all that their commands read."""
    for name in ("fixtures", "card_formats"):
        shutil.copytree(root / name, out / name)
    for page in (root / "README.md", *(root / "docs").glob("*.md"), Path(__file__).with_name("options.md")):
        shutil.copy(page, out / page.name)


def commands(markdown: str) -> Iterator[str]:
    """Yield the commands of a page in their order."""
    for block in _BLOCK.finditer(markdown):
        yield from _COMMAND.findall(block[1])


def run(pages: Path, out: Path) -> None:
    """Run every page, in a folder each below `out`."""
    tools = out / "bin"
    tools.mkdir(parents=True)
    program = tools / "musat"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m musatpy "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    environment = os.environ | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    for page in sorted(pages.glob("*.md")):
        folder = out / page.stem
        folder.mkdir()
        for name in ("fixtures", "card_formats"):
            shutil.copytree(pages / name, folder / name)
        for number, command in enumerate(commands(page.read_text(encoding="utf-8")), 1):
            ran = subprocess.run(
                ["bash", "-c", command],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                check=False,
            )
            said = _TIMED.sub(r"TIME \2", ran.stdout.decode(errors="replace"))
            text = f"$ {command}\n{said}\nstatus {ran.returncode}\n"
            (folder / f"{number:02}.txt").write_text(text, encoding="utf-8")
        _tidied(folder)
    shutil.rmtree(tools)


def _tidied(folder: Path) -> None:
    """Take out what was given, and what tells of the time."""
    for name in ("fixtures", "card_formats"):
        shutil.rmtree(folder / name)
    for path in folder.rglob("*"):
        if path.suffix in NOT_TEXT:
            path.write_text("not held against another one\n", encoding="utf-8")
        elif path.suffix in (".json", ".jsonl", ".csv", ".xml", ".txt"):
            text = path.read_text(encoding="utf-8", errors="replace")
            path.write_text(_LASTED.sub(r"\1TIME", text), encoding="utf-8")
