"""The index of a baseline: which decks it has, and what they and the program were when they were taken over."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from musatpy.campaign.batch_jobs import Job, JobOptions, sha256_of
from musatpy.campaign.manifest import Plan, decks_in
from musatpy.errors import MusatError
from musatpy.files import name_fault, real_path
from musatpy.runs import ExitStatus
from musatpy.specs import Reader, key

INDEX = "baseline.json"
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
    state: str = key("", "what became of it in a word; empty in a baseline of before there were verdicts")
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
            if fault := place_fault(name):
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

    def plan(self, names: Iterable[str], work: Path) -> Plan:
        """Return the jobs that make the results of decks anew, in a work folder."""
        formats = None if self.formats is None else self.folder / self.formats
        options = JobOptions(formats=formats, settings=self.settings)
        runs = {name: self.deck(run) for name, run in self.runs.items()}
        jobs = (
            Job(deck=self.deck(name), out=(work / name).parent, options=options, run=runs.get(name))
            for name in names
        )
        return Plan(jobs=tuple(jobs), folder=work, name=".batch")

    def chosen(self, names: Sequence[str]) -> list[str]:
        """Return the decks that are meant, all where none is named; raises `BaselineError`.

        A deck is named by its place in the baseline, by its path, or by the name of its file, with the ending or
        without.
        """
        decks: set[str] = set()
        for given in names:
            place = real_path(Path(given))
            meant = {name for name in self.entries if Path(given) in _short(Path(name))}
            meant = meant or {name for name in self.entries if real_path(self.deck(name)) == place}
            if not meant:
                hint = "musat baseline list names those that are, save adds others"
                raise BaselineError(f"{self.folder}: no such deck in the baseline: {given}; {hint}")
            decks |= meant
        return sorted(decks or self.entries)

    def index(self) -> bytes:
        """Return the index as JSON; of what may be missing that which is."""
        runs = {name: run for name, run in sorted(self.runs.items()) if name in self.entries}
        decks = {
            name: {key: value for key, value in asdict(entry).items() if value not in ({}, "")}
            for name, entry in sorted(self.entries.items())
        }
        data = {
            "schema_version": SCHEMA_VERSION,
            "decks_in": self.root,
            "records": self.records,
            "formats": self.formats,
            **({"settings": list(self.settings)} if self.settings else {}),
            **({"runs": runs} if runs else {}),
            "decks": decks,
        }
        return (json.dumps(data, indent=1) + "\n").encode()


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
            f"{path}: schema {version} is not {SCHEMA_VERSION}; another version made it, or {_REMEDY}"
        )
    reader = Reader()
    baseline = reader.table(Baseline, given, "")
    if reader.problems:
        wrong = "; ".join(f"{problem.field}: {problem.message}" for problem in reader.problems)
        raise BaselineError(f"{path} is not the index of a baseline ({wrong}); {_REMEDY}")
    return replace(baseline, folder=folder)


def _short(place: Path) -> set[Path]:
    """Return what a deck may be called."""
    return {place, place.with_suffix(""), Path(place.name), Path(place.stem)}


def place_fault(name: str) -> str:
    """Return why a name is not the place of a deck below the folder of the decks; empty for one that is."""
    return next(filter(None, map(name_fault, name.split("/"))), "")


def below(path: Path, folder: Path) -> str | None:
    """Return a path as seen from a folder, None where it is not below it."""
    place = Path(os.path.relpath(real_path(path), real_path(folder)))
    return None if ".." in place.parts or place.is_absolute() else place.as_posix()


def unknown_decks(baseline: Baseline) -> list[str]:
    """Return the decks that a baseline does not have, in the folders of those that it has."""
    root = baseline.folder / baseline.root
    folders = sorted({root / PurePosixPath(name).parent for name in baseline.entries})
    decks = [below(deck, root) for folder in folders for deck in decks_in(folder)]
    return [name for name in decks if name is not None and name not in baseline.entries]


def changed_decks(baseline: Baseline) -> dict[str, str]:
    """Return of each deck what became of it since it was saved.

    `as saved`, `changed` (its bytes), `gone`, `unreadable`, or `other inputs`: card formats or a geoid model.
    """
    names = sorted(baseline.entries)
    jobs = baseline.plan(names, baseline.folder).jobs
    return {name: _change_of(baseline.entries[name], job) for name, job in zip(names, jobs, strict=True)}


def _change_of(entry: Entry, job: Job) -> str:
    try:
        same = entry.is_of(job.deck, sha256_of(job.deck))
    except OSError as error:
        return "gone" if isinstance(error, FileNotFoundError) else "unreadable"
    with suppress(OSError, MusatError):  # of inputs that are not there any more
        if not same or not entry.changed_inputs(job.inputs(entry.inputs)):
            return "as saved" if same else "changed"
    return "other inputs"
