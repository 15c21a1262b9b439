"""`musat convert`: a job from one family of formats to another."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain_of, name_of, tell
from musatpy.cli.options import family_named, refuse_overwriting, submerged_option
from musatpy.errors import Problem

if TYPE_CHECKING:
    from musatpy.formats.families import FormatFamily


@click.command(name="convert", short_help="Convert a job between decks and other agencies' files.")
@click.argument("source", metavar="FROM", type=click.Path(path_type=Path, exists=True))
@click.argument("target", metavar="TO", type=click.Path(path_type=Path))
@click.option("--from", "source_name", metavar="FAMILY", help="Family of FROM, where its name does not say it.")
@click.option("--to", "target_name", metavar="FAMILY", help="Family of TO, where its name does not say it.")
@click.option(
    "--deck",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="A deck, which need not be whole, for what FROM does not hold: camera, options, water.",
)
@submerged_option
@click.option(
    "--formats",
    "own",
    metavar="DIR",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="A family of your own: a folder of format files (TOML), named as the folder.",
)
def command(
    source: Path,
    target: Path,
    source_name: str | None,
    target_name: str | None,
    deck: Path | None,
    submerged: Path | None,
    own: Path | None,
) -> None:
    """Convert the job FROM to TO, and say what TO cannot hold.

    Families are musat (*.crd), giant, patb, bingo and jfk, or your own. FROM and TO are a file, or a folder of
    files that belong together; of a set of files any one stands for all.

    Exit status: 0 written, 1 FROM cannot be used or TO cannot hold it at all (nothing is written).
    """
    from musatpy.files import write_files
    from musatpy.formats.families import DeckFamily, families
    from musatpy.formats.parts import deck_parts

    known = families(own)
    from_family = _family(known, source, source_name, "--from", is_target=False)
    to_family = _family(known, target, target_name, "--to", is_target=True)
    if deck is not None and isinstance(from_family, DeckFamily):
        raise click.UsageError("--deck is for files that do not hold everything; FROM is a deck itself")
    stem = source.resolve().name if source.is_dir() else source.stem
    _check_overwriting(from_family, source, to_family, target, stem)
    parts, warnings = from_family.read(source, {} if deck is None else deck_parts(deck))
    complain_of(warnings)
    if submerged is not None:
        from musatpy.formats.job_tables import with_flags
        from musatpy.jobs.point_flags import PointFlags, flags_of_parts

        more = flags_of_parts(parts, PointFlags(submerged=submerged))
        parts = {role: with_flags(role, table, more.flags) for role, table in parts.items()}
        tell(more.settings[0])
        complain_of(Problem(message=note, severity="warning") for note in more.undecided)
    rendered = to_family.render(parts, target, stem)
    write_files(rendered.contents)
    for file in rendered.contents:
        tell(f"wrote {name_of(file)}")
    for line in rendered.left_out:
        tell(line)
    complain_of(rendered.warnings)


def _family(
    known: Mapping[str, FormatFamily], path: Path, name: str | None, option: str, *, is_target: bool
) -> FormatFamily:
    """Return the family of a name, or the first whose files are named like `path`."""
    if name is not None:
        return family_named(known, name, option)
    if not (is_target and path.is_dir()):
        for family in known.values():
            if family.matches(path):
                return family
    patterns = "; ".join(f"{family.name} {' '.join(family.patterns)}" for family in known.values())
    raise click.UsageError(f"{name_of(path)}: give its family with {option} ({patterns})")


def _check_overwriting(
    from_family: FormatFamily, source: Path, to_family: FormatFamily, target: Path, stem: str
) -> None:
    """Raise a usage error where a file to be written is one that is read."""
    written = [path for path in to_family.targets(target, stem).values() if path.exists()]
    refuse_overwriting(written, [*from_family.targets(source, stem).values(), source])
