"""The families of formats between which jobs are converted: native decks, those of other agencies, a user's own.

A family of decks is cards, any other one files of records that belong together; both <-> parts of a block.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy import model
from musatpy.errors import DeckError, Problem, ProblemsError
from musatpy.files import write_files
from musatpy.formats import musat, parts, system_rows
from musatpy.formats.cards.deck import write_cards
from musatpy.formats.cards.spec import Family, card_formats_folder
from musatpy.formats.checks import cross_check
from musatpy.formats.job_folder import SUFFIX, draft_of_tables, files_of_tables, placed
from musatpy.formats.job_tables import KEYS, Table, Tables, attributes, card_family, is_said, size, words_of
from musatpy.formats.records.files import read_records, write_records
from musatpy.formats.records.frames import JobFrame
from musatpy.formats.records.layout import FileSpec, is_record_folder, load_files
from musatpy.formats.records.rows import (
    can_hold_control,
    check_targets,
    held,
    joined,
    parts_of_file,
    resolved,
    rows_of_parts,
    said_by,
    with_origin,
)
from musatpy.formats.short_ids import for_cards, names_csv

if TYPE_CHECKING:
    from musatpy.systems import Statement


@dataclass(frozen=True, kw_only=True)
class Rendered:
    """Files to be written, and what they do not hold, one line each."""

    contents: dict[Path, bytes]
    left_out: tuple[str, ...]
    warnings: tuple[Problem, ...] = ()
    lacks: tuple[str, ...] = ()  # what keeps a deck from running as it stands, with the option that gives it


_ANY_OPTION = "a --deck that says it"
_OPTIONS = (  # what the message of an error begins with or has, and what of a conversion gives it
    ("they need sigmas", "--control-sigma EAST,NORTH,UP"),
    ("it needs a sigma", "--control-sigma EAST,NORTH,UP"),
    ("no exposure stations", "--set OP2.initial=COMPUTE with control enough, or a --deck that says them"),
    ("no attitudes", "--set OP2.initial=COMPUTE with control enough, or a --deck that says them"),
)


def _lacks(problems: Iterable[Problem]) -> tuple[str, ...]:
    """Return a line for each kind of error, with how many there are, and the option that helps."""
    errors = [problem for problem in problems if problem.severity == "error"]
    counts = Counter(problem.kind for problem in errors)
    first = {problem.kind: problem for problem in reversed(errors)}
    lines = []
    for kind in counts:
        message = first[kind].message or first[kind].headline()
        option = next((option for words, option in _OPTIONS if words in message), _ANY_OPTION)
        more = f" ({counts[kind]} cards)" if counts[kind] > 1 else ""
        lines.append(f"{message}{more}: {option}")
    return tuple(lines)


@dataclass(frozen=True)
class DeckFamily:
    """Decks of cards: one file, which holds everything."""

    name: str
    cards: Family
    patterns: tuple[str, ...] = musat.PATTERNS

    def matches(self, path: Path) -> bool:
        """Return whether a file is named as a deck."""
        return any(path.match(pattern) for pattern in self.patterns)

    def targets(self, path: Path, stem: str) -> dict[Any, Path]:
        """Return the deck that is written."""
        return {self.name: path / self.patterns[0].replace("*", stem) if path.is_dir() else path}

    def read(self, path: Path, given: Tables) -> tuple[Tables, tuple[Problem, ...]]:
        """Return what a deck says; raises `DeckError` with every problem."""
        block, problems = musat.check_deck(path, self.cards)
        if block is None:
            raise DeckError(problems)
        return parts.parts_of(block), problems

    def render(self, given: Tables, path: Path, stem: str) -> Rendered:
        """Return a deck, and what keeps it from running as it stands."""
        missing = parts.missing_parts(given)
        if missing:
            raise DeckError(missing)
        given, renamed = for_cards(given)
        data = write_cards(parts.cards_of_parts(given, self.cards))
        _, problems = musat.check_deck(data, self.cards)
        (place,) = self.targets(path, stem).values()
        names = {place.with_suffix(".ids.csv"): names_csv(renamed)} if renamed else {}
        if "systems" in given:
            message = "SYS cards are left out: coordinates and attitudes are converted as the adjustment has them"
            problems = (Problem(message=message, severity="warning"), *problems)
        warnings = tuple(replace(problem, file=str(place)) for problem in problems if problem.severity == "warning")
        contents = {**names, place: data}
        return Rendered(contents=contents, left_out=(), warnings=warnings, lacks=_lacks(problems))


@dataclass(frozen=True)
class JobFamily(DeckFamily):
    """Job folders, which hold everything, names of any length too."""

    patterns: tuple[str, ...] = (f"*{SUFFIX}",)

    def targets(self, path: Path, stem: str) -> dict[Any, Path]:
        """Return the folder that is written."""
        folder = path.parent if path.suffix else path
        return {self.name: path if self.matches(path) else folder / f"{stem}{SUFFIX}"}

    def render(self, given: Tables, path: Path, stem: str) -> Rendered:
        """Return the files of a job, and what keeps it from running as it stands."""
        (place,) = self.targets(path, stem).values()
        draft = draft_of_tables(given, str(place), self.cards)
        problems = [placed(problem, draft) for problem in cross_check(draft)]
        warnings = tuple(problem for problem in problems if problem.severity == "warning")
        contents = files_of_tables(given, place)
        return Rendered(contents=contents, left_out=(), warnings=warnings, lacks=_lacks(problems))


@dataclass(frozen=True)
class RecordSet:
    """The family whose formats stand in a folder. Raises `CardFormatError` when a wrong one is first used."""

    folder: Path

    @property
    def name(self) -> str:
        """The name of the family."""
        return self.folder.resolve().name

    @cached_property
    def files(self) -> tuple[FileSpec, ...]:
        """The kinds of files, in their order."""
        files = load_files(self.folder)
        for file in files:
            check_targets(file)
        return files

    @property
    def patterns(self) -> tuple[str, ...]:
        """The names, or patterns of names, of the files."""
        return tuple(file.file for file in self.files)

    # --- which files ---

    def found(self, path: Path) -> dict[FileSpec, Path]:
        """Return the files that are there: in the folder `path`, or of the same stem as the file `path`.

        Raises `DeckError` for a folder with files of several stems.
        """
        folder, stem = (path, None) if path.is_dir() else (path.parent, path.stem)
        if path.is_file() and len(self.files) == 1:
            return {self.files[0]: path}
        files: dict[FileSpec, Path] = {}
        stems: set[str] = set()
        for candidate in sorted(folder.iterdir()) if folder.is_dir() else ():
            file = self._kind(candidate)
            fixed = file is not None and "*" not in file.file
            if file is None or not (fixed or stem is None or candidate.stem == stem):
                continue
            files.setdefault(file, candidate)
            stems |= set() if fixed else {candidate.stem}
        if len(stems) > 1:
            names = ", ".join(sorted(stems))
            raise DeckError.of(f"files of several sets ({names}); name a file of one", file=path)
        return {file: files[file] for file in self.files if file in files}

    def _kind(self, path: Path) -> FileSpec | None:
        name = path.name.lower()
        return next((file for file in self.files if fnmatchcase(name, file.file.lower())), None)

    def matches(self, path: Path) -> bool:
        """Return whether a file is named as one of the family, or a folder has such files."""
        if path.is_dir():
            return any(self._kind(one) is not None for one in path.iterdir())
        return self._kind(path) is not None

    def targets(self, path: Path, stem: str) -> dict[FileSpec, Path]:
        """Return the files that a set is written to: into the folder `path`, or beside the file `path`."""
        kind = self._kind(path)
        fixed = all("*" not in pattern for pattern in self.patterns)
        into_folder = path.is_dir() or (kind is None and not path.suffix and fixed)
        folder = path if into_folder else path.parent
        if not into_folder:
            stem = path.stem if kind is not None or path.suffix else path.name
        return {file: folder / file.file.replace("*", stem) for file in self.files}

    # --- parts ---

    def read(self, path: Path, given: Tables) -> tuple[Tables, tuple[Problem, ...]]:
        """Return what the files say, completed by `given`, and warnings.

        Raises `DeckError` with every problem of every file, and `OSError`.
        """
        try:
            return self._read(path, given)
        except ProblemsError as error:  # some are of no file: what they lack
            raise DeckError(replace(one, file=one.file or str(path)) for one in error.problems) from error

    def _read(self, path: Path, given: Tables) -> tuple[Tables, tuple[Problem, ...]]:
        files = self.found(path)
        if not files:
            expected = ", ".join(self.patterns)
            raise DeckError.of(f"no file of the family {self.name} ({expected})", file=path)
        frame = _frame(given)
        problems: list[Problem] = []
        tables_of: dict[str, list[Table]] = {}
        for file, place in files.items():
            read = read_records(place.read_bytes(), resolved(file, frame), str(place))
            problems += read.problems
            if musat.has_errors(read.problems):
                continue  # rows are missing: what is wrong between them says nothing
            read_parts, faults = parts_of_file(read, frame)
            problems += faults
            for role, table in read_parts.items():
                tables_of.setdefault(role, []).append(table)
        if musat.has_errors(problems):
            raise DeckError(problems)
        read_parts = {role: joined(role, tables) for role, tables in tables_of.items()}
        stated = parts.statement_of(given)
        if stated is not None and {"stations", "control"} & set(read_parts):  # the files do not say it themselves
            problems.append(Problem(file=str(path), message=f"read as {self._words(stated)}", severity="warning"))
        result = parts.merged(given, read_parts)
        if "plates" in read_parts and any(file.origin_at_principal_point for file in files):
            result = with_origin(result, at_principal_point=False)
        return result, tuple(problems)

    def render(self, given: Tables, path: Path, stem: str = "block") -> Rendered:
        """Return the files that have something to say, and what they leave out.

        Raises `DeckError` with every value that a file cannot hold.
        """
        frame = _frame(given)
        contents: dict[Path, bytes] = {}
        problems: list[Problem] = []
        for file, place in self.targets(path, stem).items():
            spec = resolved(file, frame)
            try:
                rows = rows_of_parts(spec, given, frame)
                if rows:
                    contents[place] = write_records(spec, rows, str(place))
            except DeckError as error:
                problems += error.problems
        raw = model.Plates.RAW in given.get("reduction", {}).get("reduction.plates", ())
        if raw and "plates" in held(self.files) and "fiducial_measurements" not in held(self.files):
            message = f"the plate coordinates are comparator readings (RED), and {self.name} holds refined ones"
            problems.append(Problem(message=message))
        if not problems and not contents:
            problems.append(Problem(message=f"the family {self.name} can hold nothing of this job"))
        if problems:
            raise DeckError(problems)
        return Rendered(contents=contents, left_out=self.left_out(given))

    # --- blocks ---

    def load_one(self, path: Path | str, deck: Path | str | None = None) -> model.Block:
        """Return the block in the files of a set, completed by a deck (camera, options, water, ...).

        Raises `DeckError` with every problem, or with what is missing, and `OSError`.
        """
        given = {} if deck is None else parts.deck_parts(deck)
        return parts.block_of(self.read(Path(path), given)[0])

    def dump_one(self, block: model.Block, path: Path | str) -> tuple[str, ...]:
        """Write a block to the files of a set, and return what they cannot hold, one line each."""
        rendered = self.render(parts.parts_of(block), Path(path))
        write_files(rendered.contents)
        return rendered.left_out

    def left_out(self, given: Tables) -> tuple[str, ...]:
        """Return what of the parts the family cannot hold, one line each."""
        holds = held(self.files)
        lines: list[str] = []
        geographic = parts.system_of(given) is model.CoordinateSystem.GEOGRAPHIC
        stated = parts.statement_of(given)
        if stated is not None and {"stations", "control"} & set(given) & set(holds):
            lines.append(f"{self.name}: {self._words(stated)}")
        elif geographic and any(file.rectangular for file in self.files) and {"stations", "control"} & set(given):
            lines.append(f"{self.name} holds rectangular coordinates: geocentric ones are written")
        for role, table in given.items():
            if size(table) and role not in system_rows.TABLES:
                losses = self._losses(role, table, given, holds.get(role, set()))
                lines += [f"{self.name} holds no {what}: {count} left out" for what, count in losses if count]
        return tuple(lines)

    def _words(self, stated: Statement) -> str:
        """Return in which system the files have coordinates and attitudes."""
        vertical = any(file.vertical_attitude and "attitudes" in held([file]) for file in self.files)
        if vertical and not stated.along_system:
            return f"coordinates of {stated.system.text}, attitudes {stated.axes_text}"
        return f"coordinates and attitudes of {stated.system.text}"

    def _losses(self, role: str, table: Table, given: Tables, holds: set[str]) -> Iterator[tuple[str, int]]:
        """Yield what of a table the files cannot hold, which `holds` of its attributes, and how many of that."""
        if not holds:
            yield words_of(role), size(table)
            return
        if role == "plates" and "plates.triangulated" not in holds:
            yield "measurements kept out of the solution", int((~table["plates.triangulated"].astype(bool)).sum())
        kinds = [(file, leaf, said_by(file, leaf).keys()) for file in self.files for leaf in file.leaves()]
        other = {"stations": "attitudes", "attitudes": "stations"}.get(role, "")
        if any({role, other} <= roles for _, _, roles in kinds):  # one row says both
            photos = table["photos.ids"]
            with_both = np.isin(photos, given[other]["photos.ids"] if other in given else photos[:0])
            yield f"{role} without {other}", int((~with_both).sum())
        if role == "control":
            frame = _frame(given)
            fits = np.any(
                [can_hold_control(file, leaf, table, frame) for file, leaf, roles in kinds if role in roles], axis=0
            )
            for kind in model.ControlKind:
                yield f"such {kind.name.lower()} control", int((~fits & (table["control.kind"] == kind)).sum())
        for path, column in table.items():
            if path not in (*holds, *KEYS.get(role, ()), "plates.triangulated", "control.kind"):
                name = attributes(role)[path].noun or path.partition(".")[2].replace("_", " ")
                yield f"{name} of {words_of(role)}", int(is_said(path, column).sum())


def _frame(given: Tables) -> JobFrame:
    """Return the coordinates of the job as the files have them."""
    return JobFrame(parts.system_of(given), parts.ellipsoid_of(given), parts.statement_of(given))


FormatFamily = DeckFamily | RecordSet  # what both can do: name, patterns, matches, targets, read, render


def agencies() -> dict[str, RecordSet]:
    """Return the families of other agencies by name: the folders of card_formats that state files of records."""
    folders = [folder for folder in sorted(card_formats_folder().iterdir()) if is_record_folder(folder)]
    return {folder.name: RecordSet(folder) for folder in folders}


def families(own: Path | None = None) -> dict[str, FormatFamily]:
    """Return the families by name, and the one in the folder `own` of TOML files, which comes first.

    Raises `CardFormatError` for formats that are wrong.
    """
    families: dict[str, FormatFamily] = {}
    if own is not None:
        name = own.resolve().name
        families[name] = RecordSet(own) if is_record_folder(own) else DeckFamily(name, card_family(own))
        families[name].patterns  # noqa: B018 - wrong formats are found now
    families.setdefault("musat", DeckFamily("musat", card_family()))
    families.setdefault("job", JobFamily("job", card_family()))
    for name, family in agencies().items():
        families.setdefault(name, family)
    return families
