"""Baselines: listings and records of a set of decks, kept as plain files, that later runs are held against.

A folder has `baseline.json` (the index: which decks, their hashes, the program's version), and of each deck its
listing and, unless it has listings only, its record, in the places that the decks have below their common folder.
Of a deck that is expected to be unusable it has what the program says. `rules.toml`, `record_rules.toml` and
`message_rules.toml` say what may differ. New results go to a work folder until they are accepted.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import musatpy
from musatpy.campaign.batch import BatchResult, Watch, run_batch
from musatpy.campaign.batch_jobs import BatchJob, JobOptions, JobOutcome, sources_sha256
from musatpy.campaign.locks import FolderLocks
from musatpy.campaign.manifest import BatchPlan, check_jobs
from musatpy.errors import MusatError, of_each_kind, printable
from musatpy.files import name_fault, real_path, remove_leftovers, write_files
from musatpy.listings import load_rules
from musatpy.runs import ExitStatus
from musatpy.specs import Reader, key

INDEX = "baseline.json"
WORK = ".new"  # below the baseline: new results until they are accepted
LISTING, RECORD, MESSAGES = "lst", "json", "err"
RULES = {LISTING: "rules.toml", RECORD: "record_rules.toml", MESSAGES: "message_rules.toml"}
SCHEMA_VERSION = "1.0"
_REMEDY = "restore it (git checkout), or save the baseline anew"


class BaselineError(MusatError):
    """A baseline that cannot be used, or something that cannot be done with it."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One deck of a baseline, as it was when its results were taken over."""

    deck_sha256: str = key()
    version: str = key(doc="of the program")
    status: int = key(doc="of its run: 0 accepted or doubtful, 1 unusable, 3 not converged, 4 rejected")
    state: str = key(doc="what became of it in a word")
    inputs: dict[str, str] = key(dict, "card formats and geoid models -> SHA-256")
    sources: str = key("", "SHA-256 of the program's; empty in a baseline of before it was kept")

    @property
    def fails(self) -> bool:
        """True for a deck that is expected to be unusable."""
        return self.status == ExitStatus.UNUSABLE

    def is_of(self, deck: Path, sha256: str | None) -> bool:
        """Tell whether a deck that has this hash is the one that was saved, but for line ends (by git)."""
        try:
            cards = deck.read_bytes().replace(b"\r\n", b"\n")
        except OSError:
            return sha256 == self.deck_sha256
        both = (cards, cards.replace(b"\n", b"\r\n"))
        return self.deck_sha256 in [sha256, *(hashlib.sha256(data).hexdigest() for data in both)]

    def changed_inputs(self, inputs: dict[str, str]) -> list[str]:
        """Return the names of inputs besides the deck that are other ones, gone or new."""
        return [name for name in sorted(self.inputs | inputs) if self.inputs.get(name) != inputs.get(name)]


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A baseline as its index says it."""

    folder: Path = Path()
    root: str = key(doc="the common folder of the decks, seen from `folder`", name="decks_in")
    records: bool = key(True, "false: listings only")
    formats: str | None = key(None, "folder of card formats, seen from `folder`")
    settings: tuple[str, ...] = key((), "fields of cards that are set for its runs")
    runs: dict[str, str] = key(dict, "compilation decks -> those of their triangulations")
    entries: dict[str, Entry] = key(doc="by the place of the deck below the root", name="decks")

    @staticmethod
    def faults(index: dict[str, Any]) -> Iterator[tuple[str, str]]:
        """Yield the names of an index that are no places of decks: nothing is written there."""
        runs = index.get("runs", {})
        for name in (*index.get("decks", ()), *runs, *runs.values()):
            if fault := _place_fault(name):
                yield "decks", f"'{name}' is not the place of a deck: it {fault}"

    def deck(self, name: str) -> Path:
        """Return where a deck is, as short as can be: `..` behind a link to a folder leads elsewhere."""
        plain = os.path.normpath(self.folder)
        place = plain if os.path.realpath(plain) == os.path.abspath(plain) else real_path(self.folder)
        return Path(os.path.normpath(Path(place) / self.root / name))

    def kept(self, name: str) -> dict[str, Path]:
        """Return the files that are kept of a deck, by their endings."""
        return self.files(name, self.folder, fails=self.entries[name].fails)

    def files(self, name: str, folder: Path, *, fails: bool) -> dict[str, Path]:
        """Return what a deck leaves below a folder: its results, or if it `fails` what the program says of it."""
        endings = [MESSAGES] if fails else [LISTING, RECORD] if self.records else [LISTING]
        return {ending: (folder / name).with_suffix(f".{ending}") for ending in endings}

    def plan(self, names: Iterable[str], work: Path) -> BatchPlan:
        """Return the jobs that make the results of decks anew, in a work folder."""
        formats = None if self.formats is None else self.folder / self.formats
        options = JobOptions(formats=formats, settings=self.settings)
        runs = {name: self.deck(run) for name, run in self.runs.items()}
        jobs = (
            BatchJob(deck=self.deck(name), out=(work / name).parent, options=options, run=runs.get(name))
            for name in names
        )
        return BatchPlan(jobs=tuple(jobs), folder=work, name=".batch")

    def chosen(self, names: Sequence[str]) -> list[str]:
        """Return the decks that are meant, all where none is named; raises `BaselineError`.

        A deck is named by its place in the baseline, by its path, or by the name of its file, with the ending or
        without.
        """
        decks: set[str] = set()
        for given in map(Path, names):
            meant = {name for name in self.entries if given in _names_of(Path(name))}
            meant = meant or {name for name in self.entries if real_path(self.deck(name)) == real_path(given)}
            if not meant:
                hint = "musat baseline list names those that are, save adds others"
                raise BaselineError(f"{self.folder}: no such deck in the baseline: {given}; {hint}")
            decks |= meant
        return sorted(decks or self.entries)

    def index(self) -> bytes:
        """Return the index as JSON; of what may be missing that which is."""
        data = {
            "schema_version": SCHEMA_VERSION,
            "decks_in": self.root,
            "records": self.records,
            "formats": self.formats,
            "settings": list(self.settings),
            "runs": {name: run for name, run in sorted(self.runs.items()) if name in self.entries},
            "decks": {
                name: {key: value for key, value in asdict(entry).items() if value not in ({}, "")}
                for name, entry in sorted(self.entries.items())
            },
        }
        given = {key: value for key, value in data.items() if key not in ("settings", "runs") or value}
        return (json.dumps(given, indent=1) + "\n").encode()


def load_baseline(folder: Path) -> Baseline:
    """Return the baseline of a folder; raises `BaselineError` where there is none or its index is wrong."""
    path = folder / INDEX
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise BaselineError(f"{folder}: no baseline here ({INDEX}); musat baseline save makes one") from error
    except (ValueError, RecursionError) as error:
        raise BaselineError(f"{path} is no JSON: {error}; {_REMEDY}") from error
    given = {name: value for name, value in data.items() if value is not None} if isinstance(data, dict) else {}
    version = given.pop("schema_version", "none")
    if version != SCHEMA_VERSION:
        raise BaselineError(
            f"{path}: schema {version} is not {SCHEMA_VERSION}; another version has written it, or {_REMEDY}"
        )
    reader = Reader()
    baseline = reader.table(Baseline, given, "")
    if reader.problems:
        wrong = "; ".join(f"{problem.field}: {problem.message}" for problem in reader.problems)
        raise BaselineError(f"{path} is not the index of a baseline ({wrong}); {_REMEDY}")
    return replace(baseline, folder=folder)


def _names_of(place: Path) -> tuple[Path, ...]:
    """Return what a deck may be called."""
    return place, place.with_suffix(""), Path(place.name), Path(place.stem)


def _place_fault(name: str) -> str:
    """Return why a name is not the place of a deck below the folder of the decks; empty for one that is."""
    return next(filter(None, map(name_fault, name.split("/"))), "")


def below(path: Path, folder: Path) -> str | None:
    """Return a path as seen from a folder, None where it is not below it."""
    place = Path(_seen_from(folder, path))
    return None if ".." in place.parts or place.is_absolute() else place.as_posix()


def _seen_from(folder: Path, path: Path) -> str:
    return os.path.relpath(real_path(path), real_path(folder))


@dataclass(frozen=True, kw_only=True)
class Taken:
    """What was taken over into a baseline."""

    baseline: Baseline
    batch: BatchResult
    new: tuple[str, ...]  # decks whose files were not there before
    changed: tuple[str, ...]
    unchanged: tuple[str, ...]
    dropped: tuple[str, ...] = ()  # whose decks are gone
    failed: tuple[str, ...] = ()  # without results; what is kept of them was left as it is


def given_rules(rules: Path | None, record_rules: Path | None) -> dict[str, Path]:
    """Return files of rules that are given, by the endings of what they are for."""
    return {ending: path for ending, path in ((LISTING, rules), (RECORD, record_rules)) if path is not None}


def save(
    folder: Path,
    decks: Sequence[Path],
    *,
    formats: Path | None = None,
    records: bool = True,
    exact: bool = False,
    rules: Path | None = None,
    record_rules: Path | None = None,
    settings: tuple[str, ...] = (),
    unusable: bool = False,
    run: Path | None = None,
    processes: int | None = None,
    watch: Watch | None = None,
) -> Taken:
    """Make a baseline of decks in a folder, or add decks to the one that is there.

    A new one gets rules to start from, or `rules` for its listings and `record_rules` for its records, or none
    with `exact`. `settings` are set for all runs of a new one, later ones too. With `unusable` what the program
    says of decks that cannot be used is kept. With `run`, the deck of a triangulation, the decks are compilation
    decks, to be compiled on that one's run. Raises `BaselineError` for decks that are in it or
    cannot be, `RulesError`, `LockedError`, `OSError`.
    """
    given = given_rules(rules, record_rules)
    for path in given.values():
        load_rules(path)
    if record_rules is not None and not records:
        raise BaselineError(f"{folder}: rules for records go with records, and listings only are to be kept")
    files = {folder / RULES[ending]: path.read_bytes() for ending, path in given.items()}
    every, root = decks if run is None else [*decks, run], folder
    if not all(below(deck, folder) for deck in every):
        root = Path(os.path.commonpath([real_path(deck).parent for deck in every]))
    fresh = Baseline(
        folder=folder,
        root=_seen_from(folder, root),
        records=records,
        formats=None if formats is None else _seen_from(folder, formats),
        settings=settings,
        entries={},
    )
    stated = bool(formats or not records or settings or exact or given)
    _with_decks(fresh, decks, run, stated)  # refused before anything is made
    with work_folder(folder, None, to_write=True) as (work, locks):
        baseline, chosen = _with_decks(fresh, decks, run, stated)
        if not (folder / INDEX).exists() and not exact:
            for ending in (LISTING, RECORD) if records else (LISTING,):
                place = folder / RULES[ending]
                if place not in files and not place.exists():
                    files[place] = Path(__file__).with_name(place.name).read_bytes()
        batch = run_batch(baseline.plan(chosen, work), processes=processes, watch=watch, again=True, locks=locks)
        return _take_over(baseline, chosen, batch, work, also=files, unusable=unusable)


def _with_decks(
    fresh: Baseline, decks: Sequence[Path], run: Path | None, stated: bool
) -> tuple[Baseline, list[str]]:
    """Return the baseline that decks are added to, `fresh` or that of its folder, and their names in it.

    `stated`: rules, formats or settings are given, which a baseline that is there already has.
    """
    there = (fresh.folder / INDEX).exists()
    baseline = load_baseline(fresh.folder) if there else fresh
    if there and stated:
        raise BaselineError(
            f"{fresh.folder} is a baseline already, which has its rules, formats and settings: only decks are added"
        )
    root = baseline.folder / baseline.root
    names: dict[Path, str] = {}
    for deck in decks if run is None else [*decks, run]:
        name = below(deck, root)
        if name is None:
            raise BaselineError(f"{deck} is not below {root}, where the decks of the baseline are")
        if fault := _place_fault(name):
            raise BaselineError(f"{deck}: its name in the baseline {fault}")
        names[deck] = name
    chosen = list(dict.fromkeys(names[deck] for deck in decks))
    if old := [name for name in chosen if name in baseline.entries]:
        raise BaselineError(
            f"{baseline.deck(old[0])} is in the baseline; musat baseline accept takes its new results over, "
            "save adds others"
        )
    if run is not None:
        baseline = replace(baseline, runs=baseline.runs | dict.fromkeys(chosen, names[run]))
    jobs = baseline.plan([*baseline.entries, *chosen], baseline.folder).jobs
    check_jobs(jobs, also=[baseline.folder / INDEX])  # no file is that of two decks, a deck or the index
    return baseline, chosen


def accept(
    folder: Path,
    names: Sequence[str] = (),
    *,
    work: Path | None = None,
    unusable: bool = False,
    processes: int | None = None,
    watch: Watch | None = None,
) -> Taken:
    """Take new results over into a baseline, of all decks or of those named.

    They are those that a check left, where the deck, the options and the program's version are still the same; the
    other decks are run. Decks that are gone are dropped. One that had results and cannot be used any more is taken
    over as such only if `unusable`. Raises `BaselineError`, `LockedError`, `OSError`.
    """
    load_baseline(folder)  # where there is none nothing is made
    with work_folder(folder, work, to_write=True) as (place, locks):
        baseline = load_baseline(folder)
        chosen = baseline.chosen(names)
        if not (folder / baseline.root).is_dir():
            raise BaselineError(
                f"{folder / baseline.root}: the folder of the decks is not there; nothing was dropped"
            )
        gone = [name for name in chosen if not os.path.lexists(baseline.deck(name))]
        left = [name for name in chosen if name not in gone]
        batch = run_batch(baseline.plan(left, place), processes=processes, watch=watch, locks=locks)
        return _take_over(baseline, left, batch, place, gone=gone, unusable=unusable)


def _take_over(
    baseline: Baseline,
    names: Sequence[str],
    batch: BatchResult,
    work: Path,
    *,
    gone: Sequence[str] = (),
    also: dict[Path, bytes] | None = None,
    unusable: bool = False,
) -> Taken:
    """Write the new results and the index, all or none, and remove what is kept of decks that are gone."""
    if batch.interrupted:
        raise BaselineError(f"{baseline.folder}: interrupted; nothing was taken over")
    entries = {name: entry for name, entry in baseline.entries.items() if name not in gone}
    files = dict(also or {})
    outdated = [place for name in gone for place in baseline.kept(name).values()]
    became: dict[str, list[str]] = {"new": [], "changed": [], "unchanged": [], "failed": []}
    for name, outcome in zip(names, batch.outcomes, strict=True):
        was = entries.get(name)
        expected = outcome.unusable and (unusable or (was is not None and was.fails))
        if outcome.deck_sha256 is None or not (outcome.state.has_results or expected):
            became["failed"].append(name)
            continue
        entry = _entry_of(outcome, outcome.deck_sha256, baseline.deck(name), was)
        kept = baseline.files(name, baseline.folder, fails=entry.fails)
        left = new_results(baseline, name, outcome, work)
        contents = {kept[ending]: place.read_bytes() for ending, place in left.items()}
        same = entry == was and all(_is_kept(place, content) for place, content in contents.items())
        if was is not None and not same:
            entry = replace(entry, sources=sources_sha256())
            outdated += [] if was.fails == entry.fails else baseline.kept(name).values()
        entries[name] = entry
        files |= {} if same else contents
        became["unchanged" if same else "new" if was is None else "changed"].append(name)
    result = replace(baseline, entries=entries)
    index = baseline.folder / INDEX
    remove_leftovers([*files, index, *baseline.folder.rglob("*")])
    if (entries or baseline.entries) and (files or outdated or not _is_kept(index, result.index())):
        # the index last: after a kill before it the old one is true of what is not there any more
        write_files(files | {index: result.index()}, outdated=outdated)
    if work == baseline.folder / WORK:
        for name in (*names, *gone):
            for ending in RULES:
                (work / name).with_suffix(f".{ending}").unlink(missing_ok=True)
        if not any(path.suffix in (f".{LISTING}", f".{MESSAGES}") for path in work.rglob("*.*")):
            shutil.rmtree(work)  # nothing in it could be accepted later
    return Taken(
        baseline=result, batch=batch, dropped=tuple(gone), **{key: tuple(value) for key, value in became.items()}
    )


def _entry_of(outcome: JobOutcome, deck_sha256: str, deck: Path, was: Entry | None) -> Entry:
    """Return what the index says of a deck that is taken over, the same as it `was` where only line ends differ.

    What other sources of the program make too stays theirs that made it first.
    """
    return Entry(
        deck_sha256=was.deck_sha256 if was is not None and was.is_of(deck, deck_sha256) else deck_sha256,
        version=musatpy.__version__,
        status=int(outcome.state.status),
        state=outcome.state.value,
        inputs=outcome.inputs,
        sources=sources_sha256() if was is None else was.sources,
    )


def _is_kept(place: Path, content: bytes) -> bool:
    """Tell whether a file of a baseline has this content, but for line ends (by git)."""
    return place.exists() and place.read_bytes().replace(b"\r\n", b"\n") == content


def new_results(baseline: Baseline, name: str, outcome: JobOutcome, work: Path) -> dict[str, Path]:
    """Return the new files of a deck by their endings; what was said of one that cannot be used becomes one.

    That are its state, exit status and all messages of its run. The deck has its name in the baseline there, so
    that the text depends neither on the place of the baseline nor on the folder in which the program is started.
    """
    places = baseline.files(name, work, fails=outcome.unusable)
    if outcome.unusable:
        head = f"{outcome.state}, exit status {int(outcome.state.status)}: {outcome.message}"
        messages = [problem.render() for problem in of_each_kind(outcome.problems)]
        text = "\n".join([head, *messages]).replace(str(baseline.deck(name)), name)
        write_files({places[MESSAGES]: f"{printable(text)}\n".encode()})
    return places


@contextmanager
def work_folder(folder: Path, work: Path | None, *, to_write: bool = False) -> Iterator[tuple[Path, FolderLocks]]:
    """Give the work folder, locked, and the baseline too where it is to be written to.

    A work folder below the baseline is nothing for git.
    """
    place = folder / WORK if work is None else work
    if real_path(place) == real_path(folder):
        raise BaselineError(f"{place}: new results would overwrite what the baseline keeps")
    with FolderLocks() as locks:
        if to_write:
            locks.take(folder)
        locks.take(place, "; --out takes new results elsewhere")
        if work is None:
            write_files({place / ".gitignore": b"*\n"})
        yield place, locks
    with suppress(OSError):  # a new baseline in which nothing was kept
        folder.rmdir()
