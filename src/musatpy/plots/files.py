"""The files of pictures: of a record, beside it or in a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError
from musatpy.files import real_path, write_files
from musatpy.plots.gallery import KINDS, read_tables, rendered
from musatpy.plots.given_lines import given_line, given_soundings
from musatpy.plots.picture import Picture
from musatpy.plots.profile import Profile, profile_picture
from musatpy.records.tables import Tables


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """The pictures of a record: their files with a sentence each, and why others were not drawn, by their names."""

    files: tuple[Path, ...]
    sentences: tuple[str, ...]
    reasons: Mapping[str, str]


def check_names(names: Sequence[str]) -> None:
    """Raise `MusatError` for a name that no picture has."""
    there = list(dict.fromkeys(picture.name for kind in KINDS.values() for picture in kind.pictures))
    unknown = [name for name in names if name not in there]
    if unknown:
        raise MusatError(f"no picture '{unknown[0]}'; there are {', '.join(there)}")


def stem_of(record: Path, out_dir: Path | None = None) -> Path:
    """Return what the names of the pictures of a record begin with."""
    return (record.parent if out_dir is None else out_dir) / record.stem


def check_stems(records: Sequence[Path], out_dir: Path | None = None) -> None:
    """Raise `MusatError` where the pictures of two records would have the same names."""
    taken: dict[Path, Path] = {}
    for record in records:
        stem = real_path(stem_of(record, out_dir))
        if stem in taken:
            raise MusatError(
                f"the pictures of {taken[stem]} and {record} would both go to {stem_of(record, out_dir)}.*"
            )
        taken[stem] = record


def profile_of(
    line: Path | None, soundings: Path | None, crs: str = "", datum: float = 0.0, within: float | None = None
) -> Picture[Profile]:
    """Return the picture of the profile along the line of a file, with soundings of another, `within` metres of it.

    Raises `ProblemsError` where a file cannot be used, and `OSError`.
    """
    return profile_picture(
        None if line is None else given_line(line, crs),
        None if soundings is None else given_soundings(soundings, crs, datum),
        within,
    )


def pictures_of(
    tables: Tables, pictures: Sequence[Picture[Any]], stem: Path
) -> tuple[dict[Path, bytes], list[str], dict[str, str]]:
    """Return the files of pictures, named after `stem`, what each says, and why others are none.

    Raises `MusatError` without matplotlib, and where what is given for a profile cannot be brought there.
    """
    files, sentences, reasons = {}, [], {}
    for picture in pictures:
        found = rendered(picture, tables, stem.name)
        if found is None:
            reasons[picture.name] = picture.sentence(tables)
            continue
        suffix, data, sentence = found
        files[stem.with_name(f"{stem.name}.{picture.name}.{suffix}")] = data
        sentences.append(sentence)
    return files, sentences, reasons


def drawn(
    record: Path, out_dir: Path | None = None, names: Sequence[str] = (), profile: Picture[Profile] | None = None
) -> Drawn:
    """Draw the pictures of a record, or those that are named, beside it or in a folder.

    `profile` stands in for that of the gallery. Raises `RecordError` where the record cannot be used, `MusatError`
    without matplotlib, and `OSError`.
    """
    kind, tables = read_tables(record)
    wanted = [picture for picture in kind.pictures if not names or picture.name in names]
    if profile is not None:
        own = profile.numbers
        wanted = [replace(one, numbers=own) if one.name == profile.name else one for one in wanted]
    files, sentences, reasons = pictures_of(tables, wanted, stem_of(record, out_dir))
    if files:
        write_files(files)
    lacking = {name: f"is no picture of a {kind.what}" for name in names if name not in {p.name for p in wanted}}
    return Drawn(files=tuple(files), sentences=tuple(sentences), reasons={**reasons, **lacking})
