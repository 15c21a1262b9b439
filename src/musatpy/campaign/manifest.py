"""What a batch is asked to do -> jobs: a manifest (TOML), folders, globs and decks."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from glob import escape, glob, has_magic
from pathlib import Path
from typing import Any

from musatpy.campaign.job import Job, JobOptions
from musatpy.errors import MusatError, Problem, ProblemsError
from musatpy.files import real_path
from musatpy.formats.musat import PATTERNS
from musatpy.specs import read_toml

_TYPES: dict[str, type] = {"out": str, "formats": str, "carriage_control": bool, "brief": bool, "punch_edits": bool}
_TYPES |= dict.fromkeys(("punch", "punch_family", "punch_points", "punch_kind"), str)
_TYPES |= dict.fromkeys(("punch_sigmas", "punch_plates"), bool)
_NAMES = {str: "a text", bool: "true or false"}
_NO_NAME = "has a null character, which no name has"
_EDITED = ".edited.crd"


class ManifestError(ProblemsError):
    """A manifest that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is to be done, and the folder where the batch keeps its state and its summary."""

    jobs: tuple[Job, ...]
    folder: Path
    name: str  # of the summary, without its ending


def plan_of(sources: Sequence[Path], out: Path | None = None, options: JobOptions | None = None) -> Plan:
    """Return the jobs of a manifest, or of decks, folders of decks and globs.

    `out` and `options` are those of every job; a manifest says its own. Raises `ManifestError`, `MusatError`
    where there is nothing to do or two jobs would write one file, and `OSError`.
    """
    manifests = [source for source in sources if source.suffix == ".toml"]
    if not manifests:
        decks = [deck for source in sources for deck in decks_of(source)]
        jobs = [Job(deck=deck, out=out, options=options or JobOptions()) for deck in decks]
        if out is None:
            os.stat(os.path.join(_common(decks), ""))  # a folder with a name that was mistyped is not made
        return _plan(jobs, out or _common(decks), "musat-batch")
    if len(sources) > 1:
        raise MusatError("a manifest is run alone: it names all its decks")
    if out is not None or options not in (None, JobOptions()):
        raise MusatError(f"{manifests[0]}: a manifest says itself where results go and how its decks are read")
    return _of_manifest(manifests[0])


def decks_of(source: Path, seen_from: Path = Path()) -> list[Path]:
    """Return the decks of a folder or a glob in the order of their names, or a deck, which need not be there.

    The source is seen from a folder whose own name is no glob, whatever characters it has.

    In a folder NAME.edited.crd beside NAME.crd is what a run punched, and is left out, as are hidden files. What
    has the name of a deck and is none (a folder, a dangling link) is a job like any other, which says so. Raises
    `MusatError` for a folder without decks, and a glob that nothing fits, and `OSError` for a folder that may not
    be read.
    """
    wildcards = has_magic(str(source))
    pattern = os.path.join(escape(str(seen_from)), source)
    source = seen_from / source
    if os.path.isdir(source):  # of one that may not be looked at its job tells
        os.scandir(source).close()  # what may not be read would look as if it were empty
        found = decks_in(source)
        if not found and _is_named_as_deck(source):
            return [source]
        if not found:
            raise MusatError(f"{source}: no decks ({', '.join(PATTERNS)}) in this folder")
        return found
    if wildcards and not os.path.exists(source):
        found = [Path(path) for path in sorted(glob(pattern, recursive=True))]
        found = [path for path in found if not os.path.isdir(path) or _is_named_as_deck(path)]
        if not found:
            raise MusatError(f"{source}: no file is named so")
        return found
    return [source]


def decks_in(folder: Path) -> list[Path]:
    """Return the decks of a folder in the order of their names, without those that a run punched."""
    found = sorted(path for pattern in PATTERNS for path in folder.glob(pattern))
    return [path for path in found if not _is_punched(path) and not path.name.startswith(".")]


def _is_named_as_deck(path: Path) -> bool:
    return any(path.match(pattern) for pattern in PATTERNS)


def _is_punched(path: Path) -> bool:
    return path.name.endswith(_EDITED) and path.with_name(f"{path.name.removesuffix(_EDITED)}.crd").exists()


def _common(decks: Iterable[Path]) -> Path:
    """Return the folder that all decks are in or below, as it was given where they are in one."""
    parents = {deck.parent for deck in decks}
    return parents.pop() if len(parents) == 1 else Path(os.path.commonpath([real_path(p) for p in parents]))


def _plan(jobs: Iterable[Job], folder: Path, name: str) -> Plan:
    plan = Plan(jobs=tuple(dict.fromkeys(jobs)), folder=folder, name=name)
    check_jobs(plan.jobs, also=(plan.folder / f"{plan.name}.json",))
    return plan


def check_jobs(jobs: Sequence[Job], also: Iterable[Path] = ()) -> None:
    """Raise `MusatError` where two jobs, or one and a file of `also`, would write one file, or over a deck."""
    decks = {real_path(job.deck): job.deck for job in jobs}
    written: dict[Path, str] = {real_path(path): "the summary" for path in also}
    for job in jobs:
        for path in job.outputs():
            place = real_path(path)
            if place in decks:
                raise MusatError(f"the results of {job.deck} would overwrite the deck {decks[place]}")
            if place in written:
                raise MusatError(f"the results of {job.deck} and {written[place]} would both go to {path}")
            written[place] = f"those of {job.deck}"


def _of_manifest(path: Path) -> Plan:
    """Return the plan of a manifest; raises `ManifestError` with every reason, and `OSError`."""
    try:
        content = read_toml(path)
    except ValueError as error:
        raise ManifestError([Problem(file=str(path), message=str(error))]) from error
    reader = _Reader(path)
    jobs = reader.jobs(content)
    if reader.problems:
        raise ManifestError(reader.problems)
    out = content.get("out")
    return _plan(jobs, path.parent / out if out is not None else path.parent, f"{path.stem}.batch")


class _Reader:
    """Turns the content of a manifest into jobs, and keeps what is wrong with it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[Problem] = []
        text = path.read_text(encoding="utf-8-sig").splitlines()
        self.heads = [n for n, line in enumerate(text, 1) if re.match(r"\s*\[\[\s*job\s*\]\]", line)]

    def wrong(self, table: int | None, key: str | None, message: str) -> None:
        """Keep a problem of a key of a job (from 0; None: of the manifest itself)."""
        line = self.heads[table] if table is not None and table < len(self.heads) else None
        card = None if table is None else f"job {table + 1}"
        self.problems.append(Problem(file=str(self.path), line=line, card=card, field=key, message=message))

    def jobs(self, content: dict[str, Any]) -> list[Job]:
        """Return all jobs."""
        tables = content.pop("job", None)
        common = self.values(None, content)
        if not isinstance(tables, list) or not tables or not all(isinstance(one, dict) for one in tables):
            self.wrong(None, "job", "a manifest has at least one table [[job]]")
            return []
        return [job for n, table in enumerate(tables) for job in self.of_table(n, table, common)]

    def of_table(self, n: int, table: dict[str, Any], common: dict[str, Any]) -> list[Job]:
        """Return the jobs of one table."""
        decks = table.pop("deck", None)
        decks = [decks] if isinstance(decks, str) else decks
        if not isinstance(decks, list) or not decks or not all(isinstance(one, str) and one for one in decks):
            self.wrong(n, "deck", "is a deck, a folder or a glob, or a list of them")
            decks = []
        if any("\0" in one for one in decks):
            self.wrong(n, "deck", _NO_NAME)
            decks = []
        values = common | self.values(n, table)
        out = values.pop("out", None)
        if "formats" in values:
            values["formats"] = self.path.parent / values["formats"]
        options = JobOptions(**values)
        found: list[Path] = []
        try:
            options.arguments()
            found = [deck for source in decks for deck in decks_of(Path(source), self.path.parent)]
        except MusatError as error:
            self.wrong(n, None, str(error))
        except OSError as error:
            self.wrong(n, "deck", f"{error.filename}: {error.strerror}")
        folder = None if out is None else self.path.parent / out
        return [Job(deck=deck, out=folder, options=options) for deck in found]

    def values(self, n: int | None, table: dict[str, Any]) -> dict[str, Any]:
        """Return the options of a table, without those that are wrong."""
        found = {}
        for key, value in table.items():
            kind = _TYPES.get(key)
            if kind is None:
                known = ", ".join(([] if n is None else ["deck"]) + list(_TYPES))
                self.wrong(n, key, f"is not a key here; there are {known}")
            elif not isinstance(value, kind):
                self.wrong(n, key, f"is {_NAMES[kind]}")
            elif isinstance(value, str) and "\0" in value:
                self.wrong(n, key, _NO_NAME)
            else:
                found[key] = value
        return found


assert {one.name for one in fields(JobOptions)} | {"out"} == set(_TYPES)
