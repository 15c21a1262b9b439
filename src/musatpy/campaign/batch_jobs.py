"""What a batch consists of: jobs, their options, the program that runs them, and what became of each."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any

import musatpy
from musatpy.errors import MusatError, Problem
from musatpy.files import real_path
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.jobs.point_flags import PointFlags
from musatpy.model import CauseSearch, Grade, RecordContent
from musatpy.runs import ExitStatus, output_paths
from musatpy.shown_runs import Shown
from musatpy.specs import key, require


class JobState(StrEnum):
    """What became of a job."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"
    REJECTED = "rejected"  # converged, and not to be used
    NOT_CONVERGED = "not converged"  # its listing says why
    UNUSABLE = "unusable"  # the deck or its data; the problems say why
    FAILED = "failed"  # results could not be written, or the program failed
    CRASHED = "crashed"  # its process ended before the job did
    NOT_RUN = "not run"  # the batch was interrupted before

    @property
    def status(self) -> ExitStatus:
        """Return what `musat run` would have ended with."""
        return self.status_if(strict=False)

    def status_if(self, *, strict: bool) -> ExitStatus:
        """Return what `musat run`, with `--strict` or without, would have ended with."""
        return ExitStatus.of(GRADES[self], strict=strict) if self in GRADES else ExitStatus.UNUSABLE

    @property
    def has_results(self) -> bool:
        """True where a listing and a record were written."""
        return self in GRADES


GRADES = {
    JobState.ACCEPTED: Grade.ACCEPTED,
    JobState.DOUBTFUL: Grade.DOUBTFUL,
    JobState.REJECTED: Grade.REJECTED,
    JobState.NOT_CONVERGED: Grade.FAILED,
}


def path_of(value: Any) -> Path:
    """Return the path that a text is; raises `ValueError`."""
    require(isinstance(value, str), "is a text")
    return Path(value)


@dataclass(frozen=True, kw_only=True)
class JobOptions:
    """How a job is run: what `musat run` can be told. Everything else is said by the deck."""

    formats: Path | None = key(None, "folder of card formats", convert=path_of)
    settings: tuple[str, ...] = key((), "fields of cards, as `--set` has them", name="set")
    dry: Path | None = key(None, "a polygon in which points are dry for certain, as of `--dry`", convert=path_of)
    submerged: Path | None = key(None, "a list or a polygon of submerged points, or `BELOW`", convert=path_of)
    carriage_control: bool = key(False)
    brief: bool = key(False)
    csv: bool = key(False)
    plots: bool = key(False)
    html: bool = key(False)
    gis: bool = key(False)
    crs: str = key("", "system of the layers")
    record: str | None = key(None, "`full`, `tables` or `none`")
    causes: str | None = key(None, "`usual`, `all` or `none`")
    punch_edits: bool = key(False)
    punch: str | None = key(None, "`restart` or `result`")
    punch_family: str | None = key(None)
    punch_points: str | None = key(None)
    punch_kind: str | None = key(None)
    punch_sigmas: bool | None = key(None)
    punch_plates: bool | None = key(None)

    @property
    def flags(self) -> PointFlags:
        """The flags of points that are set besides those of the deck."""
        return PointFlags(dry=self.dry, submerged=self.submerged)

    @property
    def shown(self) -> Shown:
        """What is wanted for people to look at."""
        return Shown(plots=self.plots, html=self.html, gis=self.gis, crs=self.crs)

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `musatpy.runs.run_deck`; raises `MusatError` for options that contradict."""
        return dict(_arguments(self))

    def as_data(self) -> dict[str, Any]:
        """Return the options that are set, as JSON can hold them."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: str(value) if isinstance(value, Path) else value
            for name, value in values.items()
            if value is not None and (value not in (False, (), "") or name in _THREE_WAY)
        }


_THREE_WAY = ("punch_sigmas", "punch_plates")  # false is not the same as not said
OUT_OF_MEMORY = "memory ran out; fewer --jobs need less"
_FORMATS = "formats/"  # before the names of card formats among the inputs of a job
_RUN = "run/"  # before that of the deck of its triangulation
_POINTS = "points/"  # before those of lists and polygons of points


@cache
def _formats_as_read(folder: Path) -> dict[str, str]:
    """Return the hashes of card formats as they were just before this process read them, which it does once."""
    return _formats_now(folder)


def _formats_now(folder: Path) -> dict[str, str]:
    """Return the hashes of card formats; raises `OSError`."""
    return {f"{_FORMATS}{path.name}": sha256_of(path) for path in sorted(folder.glob("*.toml"))}


@cache
def _arguments(options: JobOptions) -> dict[str, Any]:
    from musatpy.formats.cards.settings import settings_of
    from musatpy.formats.families import DeckFamily, families
    from musatpy.formats.job_tables import card_family

    punch, other, own = _punch(options), None, False
    if options.crs and not options.gis:
        raise MusatError("crs goes with gis")
    if options.formats is not None:
        _formats_as_read(options.formats)
    if options.punch_family is not None:
        known = families(options.formats)
        if options.punch_family not in known:
            raise MusatError(f"punch_family: no family '{options.punch_family}'; there are {', '.join(known)}")
        punched = known[options.punch_family]
        other = None if type(punched) is DeckFamily else punched
        own = options.formats is not None and other is not None and punched.name == real_path(options.formats).name
    family = card_family(None if own else options.formats)
    same = ("carriage_control", "brief", "csv", "flags", "punch_edits")
    return {name: getattr(options, name) for name in same} | {
        "family": family,
        "settings": settings_of(options.settings, family),
        "record": RecordContent(options.record or RecordContent.FULL),
        "causes": CauseSearch(options.causes or CauseSearch.USUAL),
        "punch": punch,
        "punch_family": other,
    }


def _punch(options: JobOptions) -> Any:
    """Return what is to be punched, None for nothing; raises `MusatError` for a word that no option has."""
    from musatpy.jobs.punch import KINDS, Content, Punch, PunchedPoints

    details = [name for name in options.as_data() if name.startswith("punch_") and name != "punch_edits"]
    if options.punch is None and details:
        raise MusatError(f"{', '.join(details)}: say what to punch: punch = restart or result")
    words: dict[str, Iterable[str]] = {
        "record": RecordContent, "causes": CauseSearch, "punch": Content, "punch_points": PunchedPoints,
        "punch_kind": KINDS,
    }  # fmt: skip
    for name, known in words.items():
        if getattr(options, name) not in (None, *known):
            raise MusatError(f"{name} is one of {', '.join(known)}, not '{getattr(options, name)}'")
    if options.punch is None:
        return None
    try:
        of_punch = {name: getattr(options, f"punch_{name}") for name in ("points", "kind", "sigmas", "plates")}
        return Punch.of(options.punch, **of_punch)
    except ValueError as error:
        raise MusatError(str(error)) from error


@cache
def sources_sha256() -> str:
    """Return a hash of the sources of the package and of its own card formats, the same wherever it is installed.

    A checkout has the version of its release for months: the version alone does not say what program it is.
    """
    package, formats = Path(musatpy.__file__).resolve().parent, card_formats_folder()
    files = {
        (root.name, path.relative_to(root).as_posix()): path
        for root in (package, formats)
        for path in root.rglob("*")
        if path.suffix in (".py", ".toml")
    }
    digest = hashlib.sha256()
    for (root, name), path in sorted(files.items()):
        if root == package.name and name.startswith(("card_formats/", "examples/examples.")):
            continue  # those of a wheel, which stand elsewhere in a checkout
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{root}/{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def program() -> str:
    """Return the version of the program and what its sources are, in a word."""
    return f"{musatpy.__version__} ({sources_sha256()[:12]})"


@dataclass(frozen=True, kw_only=True)
class BatchJob:
    """One deck and where its results go."""

    deck: Path
    out: Path | None = None  # None: beside the deck
    options: JobOptions = field(default_factory=JobOptions)
    run: Path | None = None  # deck of the triangulation that a compilation deck is compiled on, which is run first

    @property
    def folder(self) -> Path:
        """Return where the results go."""
        return self.deck.parent if self.out is None else self.out

    def outputs(self) -> tuple[Path, ...]:
        """Return the files that the job may leave; raises `MusatError` for options that contradict."""
        arguments = self.options.arguments()
        paths = output_paths(
            self.deck,
            self.out,
            punch_edits=self.options.punch_edits,
            punch=arguments["punch"] is not None,
            punch_family=arguments["punch_family"],
        )
        return (*paths, self.folder / f"{self.deck.stem}.html") if self.options.html else paths

    def inputs(self, names: Iterable[str] = ()) -> dict[str, str]:
        """Return the hashes of what is read besides the deck: card formats, points, geoid models by these names.

        Of a compilation deck also that of its triangulation, but for line ends. Names may be those of an earlier
        answer. Raises `OSError`, and `MusatError` where there is no such model.
        """
        from musatpy.formats.musat import geoid_file

        grids = [name for name in names if not name.startswith((_FORMATS, _RUN, _POINTS))]
        hashes = {} if self.options.formats is None else _formats_now(self.options.formats)
        for option, path in self.options.flags.files.items():
            hashes[f"{_POINTS}{option}/{path.name}"] = sha256_of(path)
        if self.run is not None:
            cards = self.run.read_bytes().replace(b"\r\n", b"\n")
            hashes[f"{_RUN}{self.run.name}"] = hashlib.sha256(cards).hexdigest()
        return hashes | {name: sha256_of(geoid_file(name)) for name in grids}

    def formats_changed(self) -> bool:
        """Tell whether the card formats are other ones than those that this process has read."""
        folder = self.options.formats
        return folder is not None and _formats_now(folder) != _formats_as_read(folder)

    def fingerprint(self, deck_sha256: str, inputs: dict[str, str]) -> str:
        """Return what the results depend on, as one hash: the deck's bytes, other inputs, program, options."""
        options = self.options.as_data()
        for name in ("formats", *self.options.flags.files):  # their content counts, which is among the inputs
            options.pop(name, None)
        what = [deck_sha256, inputs, musatpy.__version__, sources_sha256(), self.deck.stem, options]
        return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class JobOutcome:
    """What became of a job."""

    state: JobState
    seconds: float = 0.0  # of this job alone
    deck_sha256: str | None = None  # None: the deck could not be read
    inputs: dict[str, str] = field(default_factory=dict)  # other files that were read -> SHA-256
    fingerprint: str | None = None
    photos: int | None = None  # None: not known, the deck could not be used
    points: int | None = None
    plates: int | None = None  # plate measurements
    sigma0: float | None = None
    check_points: int | None = None  # as many as its components have at most; None: not known
    check_rms: tuple[float | None, ...] | None = None  # m, of their components; None where there are none
    iterations: int | None = None
    water_passes: int | None = None
    message: str = ""  # why it failed, did not converge, is rejected or doubtful
    problems: tuple[Problem, ...] = ()
    outputs: dict[str, str] = field(default_factory=dict)  # name in the folder of the job -> SHA-256
    kept: bool = False  # True: finished by an earlier run of the batch, and not done again

    @property
    def unusable(self) -> bool:
        """True for a deck that was read and cannot be used: whatever else went wrong may go right another time."""
        return self.state is JobState.UNUSABLE and self.deck_sha256 is not None

    @property
    def reason(self) -> str:
        """Why it is as it is, in a line; of a deck that cannot be used its first error."""
        text = " ".join(self.message.split())
        errors = [problem for problem in self.problems if problem.severity == "error"]
        if self.state is not JobState.UNUSABLE or not errors:
            return text
        first = replace(errors[0], file=Path(errors[0].file or "").name).headline()
        return f"{text}: {first}" if len(errors) == 1 else f"{text}, the first: {first}"

    @classmethod
    def of_data(cls, data: dict[str, Any]) -> JobOutcome:
        """Return the outcome that `asdict` made data of; raises `TypeError`, `ValueError` for other data."""
        problems = [
            Problem(**row | {"columns": row["columns"] and tuple(row["columns"])}) for row in data["problems"]
        ]
        return cls(**data | {"state": JobState(data["state"]), "problems": tuple(problems)})


def sha256_of(path: Path) -> str:
    """Return the hash of a file in hexadecimal; raises `OSError`."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
