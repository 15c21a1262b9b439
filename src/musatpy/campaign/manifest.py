"""What a batch is asked to do -> jobs: a manifest (TOML), folders, globs and decks."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from glob import escape, glob, has_magic
from pathlib import Path
from typing import Any

from musatpy.campaign.batch_jobs import BatchJob, JobOptions, path_of
from musatpy.errors import MusatError, ProblemsError
from musatpy.files import real_path
from musatpy.formats.musat import PATTERNS
from musatpy.specs import Reader, key, keys, read_toml, require

_NO_NAME = "has a null character, which no name has"
_EDITED = ".edited.crd"
_DECKS = "a deck, a folder or a glob, or a list of them"


class ManifestError(ProblemsError):
    """A manifest that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class BatchPlan:
    """What is to be done, and the folder where the batch keeps its state and its summary."""

    jobs: tuple[BatchJob, ...]
    folder: Path
    name: str  # of the summary, without its ending

    @property
    def index(self) -> Path | None:
        """Where the index page goes, None where no job has a page."""
        return self.folder / f"{self.name}.html" if any(job.options.html for job in self.jobs) else None


def plan_of(sources: Sequence[Path], out: Path | None = None, options: JobOptions | None = None) -> BatchPlan:
    """Return the jobs of a manifest, or of decks, folders of decks and globs.

    `out` and `options` are those of every job; a manifest says its own. Raises `ManifestError`, `MusatError`
    where there is nothing to do or two jobs would write one file, and `OSError`.
    """
    manifests = [source for source in sources if source.suffix == ".toml"]
    if not manifests:
        decks = [deck for source in sources for deck in decks_of(source)]
        jobs = [BatchJob(deck=deck, out=out, options=options or JobOptions()) for deck in decks]
        if out is None:
            os.stat(os.path.join(_common(decks), ""))  # a folder with a name that was mistyped is not made
        return _plan(jobs, out or _common(decks), "musat-batch")
    if len(sources) > 1:
        raise MusatError("a manifest is run alone: it names all its decks")
    if out is not None or options not in (None, JobOptions()):
        raise MusatError(f"{manifests[0]}: the manifest itself says where results go and how its decks are read")
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
        decks = decks_in(source)
        if not decks and _is_named_as_deck(source):
            return [source]
        if not decks:
            raise MusatError(f"{source}: no decks ({', '.join(PATTERNS)}) in this folder")
        return decks
    if wildcards and not os.path.exists(source):
        decks = [Path(path) for path in sorted(glob(pattern, recursive=True))]
        decks = [path for path in decks if not os.path.isdir(path) or _is_named_as_deck(path)]
        if not decks:
            raise MusatError(f"{source}: no file has this name")
        return decks
    return [source]


def decks_in(folder: Path) -> list[Path]:
    """Return the decks of a folder in the order of their names, without those that a run punched."""
    decks = sorted(path for pattern in PATTERNS for path in folder.glob(pattern))
    return [path for path in decks if not _is_punched(path) and not path.name.startswith(".")]


def _is_named_as_deck(path: Path) -> bool:
    return any(path.match(pattern) for pattern in PATTERNS)


def _is_punched(path: Path) -> bool:
    return path.name.endswith(_EDITED) and path.with_name(f"{path.name.removesuffix(_EDITED)}.crd").exists()


def _common(decks: Iterable[Path]) -> Path:
    """Return the folder that all decks are in or below, as it was given where they are in one."""
    parents = {deck.parent for deck in decks}
    return parents.pop() if len(parents) == 1 else Path(os.path.commonpath([real_path(p) for p in parents]))


def _plan(jobs: Iterable[BatchJob], folder: Path, name: str) -> BatchPlan:
    plan = BatchPlan(jobs=tuple(dict.fromkeys(jobs)), folder=folder, name=name)
    summary = plan.folder / f"{plan.name}.json"
    check_jobs(plan.jobs, also=(summary,) if plan.index is None else (summary, plan.index))
    return plan


def check_jobs(jobs: Sequence[BatchJob], also: Iterable[Path] = ()) -> None:
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


def _decks(value: Any) -> tuple[str, ...]:
    decks = [value] if isinstance(value, str) else value
    fits = isinstance(decks, list) and bool(decks) and all(isinstance(name, str) and name for name in decks)
    require(fits, f"is {_DECKS}")
    require(not any("\0" in name for name in decks), _NO_NAME)
    return tuple(decks)


@dataclass(frozen=True, kw_only=True)
class _JobKeys(JobOptions):
    """What a manifest says of all its jobs."""

    out: Path | None = key(None, "folder of the results", convert=path_of)

    @staticmethod
    def faults(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
        """Yield the keys with a null character, and options that contradict one another."""
        for name, value in table.items():
            if isinstance(value, str) and "\0" in value and name != "deck":
                yield name, _NO_NAME
        known = keys(JobOptions)
        given = {known[name].name: value for name, value in table.items() if name in known}
        settings = given.pop("settings", [])
        are_texts = isinstance(settings, list) and all(isinstance(text, str) for text in settings)
        try:
            options = JobOptions(**given, settings=tuple(settings) if are_texts else ())
            options.arguments()
        except MusatError as error:
            yield "", str(error)


@dataclass(frozen=True, kw_only=True)
class _DeckKeys(_JobKeys):
    """What a manifest says of one of its jobs, or several."""

    deck: tuple[str, ...] = key((), _DECKS, required=True, convert=_decks)


def _of_manifest(path: Path) -> BatchPlan:
    """Return the plan of a manifest; raises `ManifestError` with every reason, and `OSError`."""
    try:
        content = read_toml(path)
    except ValueError as error:
        raise ManifestError.of(error, file=path) from error
    reader = Reader(str(path), path.read_text(encoding="utf-8-sig"))
    tables = content.pop("job", None)
    common = content if reader.table(_JobKeys, content, "") else {}
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        reader.complain("job", "a manifest has at least one table [[job]]")
        tables = []
    jobs = []
    for n, table in enumerate(tables, 1):
        job = reader.table(_DeckKeys, common | table, f"job[{n}]")
        if job:
            jobs += _jobs(job, path.parent, f"job[{n}]", reader)
    if reader.problems:
        raise ManifestError(sorted(reader.problems, key=lambda problem: problem.line or 0))
    out = content.get("out")
    return _plan(jobs, path.parent / out if out is not None else path.parent, f"{path.stem}.batch")


def _jobs(job: _DeckKeys, folder: Path, where: str, reader: Reader) -> list[BatchJob]:
    """Return the jobs of one table, whose paths are seen from a folder."""
    values = {option.name: getattr(job, option.name) for option in fields(JobOptions)}
    paths = {"formats": job.formats, **job.flags.files}
    options = JobOptions(**values | {name: path and folder / path for name, path in paths.items()})
    try:
        decks = [deck for source in job.deck for deck in decks_of(Path(source), folder)]
    except MusatError as error:
        reader.complain(where, str(error))
        return []
    except OSError as error:
        reader.complain(f"{where}.deck", f"{error.filename}: {error.strerror}")
        return []
    return [BatchJob(deck=deck, out=job.out and folder / job.out, options=options) for deck in decks]
