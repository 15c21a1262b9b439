"""The index of a baseline: which decks it has, and what they and the program were when they were taken over."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from musatpy.campaign.batch_jobs import Job, JobOptions, Outcome, sha256_of
from musatpy.campaign.manifest import Plan, decks_in, is_texts
from musatpy.errors import MusatError, of_each_kind, printable
from musatpy.files import name_fault, real_path
from musatpy.listings import Rules, load_rules
from musatpy.runs import ExitStatus

INDEX = "baseline.json"
LISTING, RECORD, MESSAGES = "lst", "json", "err"
RULES = {LISTING: "rules.toml", RECORD: "record_rules.toml", MESSAGES: "message_rules.toml"}
SCHEMA_VERSION = "1.0"


class BaselineError(MusatError):
    """A baseline that cannot be used, or something that cannot be done with it."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One deck of a baseline, as it was when its results were taken over."""

    deck_sha256: str
    version: str  # of the program
    status: int  # of its run: 0 accepted or doubtful, 1 unusable, 3 not converged, 4 rejected
    state: str = ""  # what became of it in a word; empty in a baseline of before there were verdicts
    inputs: dict[str, str] = field(default_factory=dict)  # card formats and geoid models -> SHA-256
    sources: str = ""  # SHA-256 of the program's; empty in a baseline of before it was kept

    @property
    def fails(self) -> bool:
        """True for a deck that is expected to be unusable."""
        return self.status == ExitStatus.UNUSABLE

    @property
    def program(self) -> str:
        """Version and sources of the program, the latter where they are known."""
        return f"{self.version} ({self.sources[:12]})" if self.sources else self.version

    def is_of(self, deck: Path, sha256: str | None) -> bool:
        """Tell whether a deck that has this hash is the one that was saved, but for line ends (by git)."""
        if sha256 == self.deck_sha256:
            return True
        try:
            cards = deck.read_bytes().replace(b"\r\n", b"\n")
        except OSError:
            return False
        both = (cards, cards.replace(b"\n", b"\r\n"))
        return self.deck_sha256 in [hashlib.sha256(data).hexdigest() for data in both]

    def as_data(self) -> dict[str, Any]:
        """Return the entry as JSON can hold it."""
        return {key: value for key, value in asdict(self).items() if value not in ({}, "")}

    def changed_inputs(self, inputs: dict[str, str]) -> list[str]:
        """Return the names of inputs besides the deck that are other ones, gone or new."""
        return [name for name in sorted(self.inputs | inputs) if self.inputs.get(name) != inputs.get(name)]


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A baseline as its index says it."""

    folder: Path
    root: str  # the common folder of the decks, seen from `folder`
    entries: dict[str, Entry]  # by the place of the deck below the root
    records: bool = True  # False: listings only
    formats: str | None = None  # folder of card formats, seen from `folder`
    settings: tuple[str, ...] = ()  # fields of cards that are set for its runs
    runs: dict[str, str] = field(default_factory=dict)  # compilation decks -> those of their triangulations

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
        results = [LISTING, RECORD] if self.records else [LISTING]
        return {ending: (folder / name).with_suffix(f".{ending}") for ending in ([MESSAGES] if fails else results)}

    def rules(self) -> dict[str, Rules | None]:
        """Return the rules of each ending; raises `RulesError`, `OSError`."""
        places = {ending: self.folder / name for ending, name in RULES.items()}
        return {ending: load_rules(place) if place.exists() else None for ending, place in places.items()}

    def plan(self, names: Iterable[str], work: Path) -> Plan:
        """Return the jobs that make the results of decks anew, in a work folder."""
        formats = self.folder / self.formats if self.formats is not None else None
        options = JobOptions(formats=formats, settings=self.settings)
        jobs = tuple(
            Job(
                deck=self.deck(name),
                out=(work / name).parent,
                options=options,
                run=self.deck(self.runs[name]) if name in self.runs else None,
            )
            for name in names
        )
        return Plan(jobs=jobs, folder=work, name=".batch")

    def chosen(self, names: Sequence[str]) -> list[str]:
        """Return the decks that are meant, all where none is named; raises `BaselineError`.

        A deck is named by its place in the baseline, by its path, or by the name of its file, with the ending or
        without.
        """
        decks: list[str] = []
        for given in names:
            meant = [name for name in self.entries if given in _called(name)]
            meant = meant or [name for name in self.entries if real_path(self.deck(name)) == real_path(Path(given))]
            if not meant:
                hint = "musat baseline list names those that are, save adds others"
                raise BaselineError(f"{self.folder}: no such deck in the baseline: {given}; {hint}")
            decks += meant
        return sorted(set(decks or self.entries))

    def index(self) -> bytes:
        """Return the index as JSON."""
        runs = {name: run for name, run in sorted(self.runs.items()) if name in self.entries}
        data = {
            "schema_version": SCHEMA_VERSION,
            "decks_in": self.root,
            "records": self.records,
            "formats": self.formats,
            **({"settings": list(self.settings)} if self.settings else {}),
            **({"runs": runs} if runs else {}),
            "decks": {name: self.entries[name].as_data() for name in sorted(self.entries)},
        }
        return (json.dumps(data, indent=1) + "\n").encode()


def load_baseline(folder: Path) -> Baseline:
    """Return the baseline of a folder; raises `BaselineError` where there is none or its index is wrong."""
    path = folder / INDEX
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise BaselineError(f"{folder}: no baseline here ({INDEX}); musat baseline save makes one") from error
    except (ValueError, RecursionError) as error:
        raise BaselineError(f"{path} is no JSON: {error}; {_REMEDY}") from error
    version = data.get("schema_version") if isinstance(data, dict) else None
    if isinstance(version, str) and version != SCHEMA_VERSION:
        raise BaselineError(f"{path}: schema {version} is not {SCHEMA_VERSION}; another version of musat made it")
    wrong = _wrong_in(data)
    if wrong is not None:
        raise BaselineError(f"{path} is not the index of a baseline ({wrong}); {_REMEDY}")
    return Baseline(
        folder=folder,
        root=data["decks_in"],
        entries={name: Entry(**entry) for name, entry in data["decks"].items()},
        records=data["records"],
        formats=data["formats"],
        settings=tuple(data.get("settings", ())),
        runs=data.get("runs", {}),
    )


_KEYS: dict[str, tuple[type, ...]] = {
    "schema_version": (str,),
    "decks_in": (str,),
    "records": (bool,),
    "formats": (str, type(None)),
    "settings": (list,),  # may be missing
    "runs": (dict,),  # likewise
    "decks": (dict,),
}
_ENTRY_KEYS: dict[str, tuple[type, ...]] = {
    "deck_sha256": (str,),
    "version": (str,),
    "status": (int,),
    "state": (str,),  # may be missing
    "inputs": (dict,),  # likewise
    "sources": (str,),  # likewise
}
_REMEDY = "restore it (git checkout), or save the baseline anew"


def _wrong_in(data: Any) -> str | None:
    """Return the first thing in the content of an index that is not as it should be."""
    wrong = _wrong_keys({"settings": [], "runs": {}} | data if isinstance(data, dict) else data, _KEYS)
    if wrong is not None:
        return wrong
    if not is_texts(data.get("settings", [])):
        return "settings"
    for name, run in data.get("runs", {}).items():
        if name not in data["decks"] or not isinstance(run, str) or place_fault(run):
            return f"runs, '{name}'"
    for name, entry in data["decks"].items():
        if fault := place_fault(name):
            return f"decks: '{name}' is not the place of a deck: it {fault}"
        wrong = _wrong_keys(
            {"state": "", "inputs": {}, "sources": ""} | entry if isinstance(entry, dict) else entry, _ENTRY_KEYS
        )
        if wrong is None and not all(isinstance(digest, str) for digest in entry.get("inputs", {}).values()):
            wrong = "inputs"
        if wrong is not None:
            return f"decks, '{name}': {wrong}"
    return None


def place_fault(name: str) -> str:
    """Return why a name is not the place of a deck below the folder of the decks; empty for one that is."""
    return next(filter(None, map(name_fault, name.split("/"))), "")


def _wrong_keys(data: Any, keys: dict[str, tuple[type, ...]]) -> str | None:
    """Return which key of a table is missing, unknown or of another type."""
    if not isinstance(data, dict):
        return "no table"
    for key in (*keys, *data):
        if key not in keys or key not in data or not isinstance(data[key], keys[key]):
            return str(key)
    return None


def _called(name: str) -> set[str]:
    """Return what a deck may be called."""
    path = Path(name)
    return {name, path.with_suffix("").as_posix(), path.name, path.stem}


def below(path: Path, folder: Path) -> str | None:
    """Return a path as seen from a folder, None where it is not below it."""
    place = Path(os.path.relpath(real_path(path), real_path(folder)))
    return None if ".." in place.parts or place.is_absolute() else place.as_posix()


def unknown_decks(baseline: Baseline) -> list[str]:
    """Return the decks that a baseline does not have, in the folders of those that it has."""
    folders = {str(PurePosixPath(name).parent) for name in baseline.entries}
    places = [Path(baseline.folder) / baseline.root / folder for folder in sorted(folders)]
    decks = [below(deck, baseline.folder / baseline.root) for place in places for deck in decks_in(place)]
    return [name for name in decks if name is not None and name not in baseline.entries]


def changed_decks(baseline: Baseline) -> dict[str, str]:
    """Return of each deck what became of it since it was saved.

    `as saved`, `changed` (its bytes), `gone`, `unreadable`, or `other inputs`: card formats or a geoid model.
    """
    plan = baseline.plan(sorted(baseline.entries), baseline.folder)
    return {
        name: _state_of(baseline.entries[name], job)
        for name, job in zip(sorted(baseline.entries), plan.jobs, strict=True)
    }


def _state_of(entry: Entry, job: Job) -> str:
    """Return what became of a deck since it was saved."""
    try:
        if not entry.is_of(job.deck, sha256_of(job.deck)):
            return "changed"
    except FileNotFoundError:
        return "gone"
    except OSError:
        return "unreadable"
    try:
        return "other inputs" if entry.changed_inputs(job.inputs(entry.inputs)) else "as saved"
    except (OSError, MusatError):
        return "other inputs"


def messages_of(name: str, deck: Path, outcome: Outcome) -> bytes:
    """Return what is kept of a deck that cannot be used: state, exit status and every message of its run as text.

    The deck has its name in the baseline there, so that the text depends neither on the place of the baseline nor
    on the folder in which the program is started.
    """
    messages = [problem.render() for problem in of_each_kind(outcome.problems)]
    head = f"{outcome.state}, exit status {int(ExitStatus.UNUSABLE)}: {outcome.message}"
    text = "\n".join([head, *messages]).replace(str(deck), name)
    return f"{printable(text)}\n".encode()
