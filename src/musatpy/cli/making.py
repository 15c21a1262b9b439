"""Commands that make files to begin with: `example`, `simulate`, `waves` and `convert`."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli import options
from musatpy.cli.depth import SigmasOfAxes
from musatpy.cli.messages import complain, complain_of, name_of, tell
from musatpy.cli.options import FILE, FOLDER, POSITIVE, NamedPath, flag, option
from musatpy.errors import DeckError, Problem, count_of, printable

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from musatpy.figures import ImageForm
    from musatpy.formats.families import FormatFamily
    from musatpy.formats.job_tables import Tables

_CAMERA = ("camera", "focal_length", "xp", "yp")  # fields of its card, in the order of an option
_WILL_NOT_RUN = 3  # exit status of `convert` whose deck lacks something


def _examples_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the examples that a shell may complete a text to."""
    from musatpy.examples import examples

    return options.offered(text, {name: example.title for name, example in examples().items()})


@click.command(name="example", short_help="Write an example to begin with.")
@click.argument("name", metavar="[NAME]", required=False, shell_complete=_examples_beginning)
@option("-o --out DIR", "Folder of the files. Default: a folder NAME.", FOLDER, name="out_dir")
def example_command(name: str | None, out_dir: Path | None) -> None:
    """List the examples; with a NAME, write its files and say how to go on.

    Exit status: 0, or 1 if a file cannot be written, or exists already with other contents.
    """
    from musatpy.examples import example_named, examples, write_example

    if name is None:
        every = examples()
        width = max(map(len, every))
        for example in every.values():
            tell(f"{example.name:<{width}}  {example.title}")
        tell("\nmusat example NAME -o DIR writes one")
        return
    with options.usage_errors():
        chosen = example_named(name)
    folder = out_dir or Path(name)
    for path in write_example(chosen, folder):
        tell(f"wrote {name_of(path)}")
    tell("\nGo on with")
    for line in (f"cd {shlex.quote(os.fspath(folder))}", *chosen.commands):
        tell(f"  {line}")


@click.command(name="simulate", short_help="Write a deck with known truth from a spec.")
@click.argument("spec", type=FILE)
@option("--seed", "Seed of the random numbers. Default: that of the spec.", click.IntRange(min=0))
@options.keys_option("musatpy.simulation.simulation_spec:SimulationSpec")
@options.out_option
def simulate_command(spec: Path, seed: int | None, out_dir: Path | None) -> None:
    """Write the deck NAME.crd that SPEC describes, and its truth as NAME.truth.json.

    If SPEC has a table [compilation], NAME.compilation.crd with readings in its models, their truth, and
    NAME.soundings.csv are written too.

    The same spec and seed always give the same files.
    """
    from musatpy.files import write_files
    from musatpy.formats.compilation_deck import compilation_bytes
    from musatpy.formats.musat import deck_bytes
    from musatpy.simulation import simulate, truth_json

    folder = spec.parent if out_dir is None else out_dir
    deck, truth = folder / f"{spec.stem}.crd", folder / f"{spec.stem}.truth.json"
    options.refuse_overwriting([deck, truth], [spec])
    simulation = simulate(spec, seed)
    files = {deck: deck_bytes(simulation.block), truth: truth_json(simulation).encode()}
    tell_of = f"{name_of(deck)}: {len(simulation.block.photos.ids)} photos, truth {name_of(truth)}"
    if (compiled := simulation.compiled) is not None:
        readings = folder / f"{spec.stem}.compilation.crd"
        files |= {
            readings: compilation_bytes(compiled.deck),
            readings.with_suffix(".truth.csv"): compiled.truth_csv().encode(),
            folder / f"{spec.stem}.soundings.csv": compiled.soundings.encode(),
        }
        tell_of += f", readings {name_of(readings)}"
    write_files(files)
    tell(tell_of)


@click.command(name="waves", short_help="Compute the errors of a map that takes wavy water as level.")
@click.argument("spec", type=FILE)
@flag("--plots", "Also draw pictures (NAME.map.png, ...); needs the extra 'plots'.")
@options.picture_options("plots")
@options.keys_option("musatpy.sea.experiment:WaveSpec")
@options.out_option
def waves_command(spec: Path, plots: bool, form: ImageForm, out_dir: Path | None) -> None:
    """Run the wave experiment of SPEC: its report goes to NAME.waves.txt, every point to NAME.waves.csv."""
    from musatpy.files import write_files
    from musatpy.reports.sea import points_csv, waves_text
    from musatpy.sea.experiment import load_spec, study

    folder = spec.parent if out_dir is None else out_dir
    result = study(load_spec(spec), str(spec))
    text, table = folder / f"{spec.stem}.waves.txt", folder / f"{spec.stem}.waves.csv"
    files = {text: waves_text(result).encode(), table: points_csv(result).encode()}
    if plots:
        from musatpy.sea.pictures import pictures

        files |= {folder / f"{spec.stem}.{name}": image for name, image in pictures(result, form).items()}
    options.refuse_overwriting(files, [spec])
    write_files(files)
    sigma = ", ".join(f"{name} {value:.3f}" for name, value in zip("XYZ", result.spread.sigma, strict=True))
    says = "kept" if result.spread.kept.all() else "exceeded"
    tell(f"{name_of(text)}: sigma {sigma} m, accuracy {says}")


@click.command(name="convert", short_help="Convert a job between decks and other agencies' files.")
@click.argument("source", metavar="FROM", type=NamedPath(exists=True))
@click.argument("target", metavar="TO", type=FILE)
@option("--from FAMILY", "Family of FROM, if its name does not tell.", name="source_name")
@option("--to FAMILY", "Family of TO, if its name does not tell.", name="target_name")
@option(
    "--deck",
    "Deck, which may be incomplete, with what FROM does not hold: camera, options, water.",
    NamedPath(exists=True, dir_okay=False),
)
@option(
    "--camera NAME=FOCAL[,X,Y]|FILE",
    "A camera: focal length, principal point, mm; or a table of cameras, columns named as on the CAM card.",
    name="cameras",
    multiple=True,
)
@option("--plate-sigma UM", "Standard deviation of plate coordinates, um.", POSITIVE)
@option(
    "--control-sigma EAST,NORTH,UP",
    "Standard deviations of control that has none, m; one number for all, or two for plan and height.",
    SigmasOfAxes({1: (0, 0, 0), 2: (0, 0, 1), 3: (0, 1, 2)}),  # east, north, up
)
@options.set_option
@options.submerged_option
@option(
    "--formats DIR",
    "Folder of format files (TOML): a family of your own, named like the folder.",
    NamedPath(exists=True, file_okay=False),
)
@click.pass_context
def convert_command(
    ctx: click.Context,
    source: Path,
    target: Path,
    source_name: str | None,
    target_name: str | None,
    deck: Path | None,
    cameras: tuple[str, ...],
    plate_sigma: float | None,
    control_sigma: tuple[float, ...] | None,
    settings: tuple[str, ...],
    submerged: Path | None,
    formats: Path | None,
) -> None:
    """Convert the job FROM to TO, and say what TO cannot hold.

    Families are musat (*.crd), giant, patb, bingo and jfk, or your own. FROM and TO are a file, or a folder of
    files that belong together; any file of a set stands for the whole set.

    Exit status: 0 written, 1 FROM cannot be used or TO cannot hold it at all (nothing is written), 3 the deck that
    is written will not run as it stands: what it lacks is listed, with the option that gives it.
    """
    from musatpy.files import write_files
    from musatpy.formats.families import DeckFamily, families
    from musatpy.formats.job_tables import card_family
    from musatpy.formats.parts import given_parts, with_control_sigmas

    known = families(formats)
    from_family = _family(known, source, source_name, "--from", is_target=False)
    to_family = _family(known, target, target_name, "--to", is_target=True)
    if isinstance(from_family, DeckFamily):
        of_files = {"--deck": deck, "--camera": cameras, "--plate-sigma": plate_sigma, "--set": settings}
        for option in (option for option, value in of_files.items() if value):
            raise click.UsageError(f"{option} is for files that do not hold everything; FROM is a deck itself")
    texts = [*settings, *([] if plate_sigma is None else [f"OPT.plate_sigma={plate_sigma:g}"])]
    cards, given_settings = _camera_cards(cameras), options.settings_for(texts, card_family())
    stem = source.resolve().name if source.is_dir() else source.stem
    written = [path for path in to_family.targets(target, stem).values() if path.exists()]
    options.refuse_overwriting(written, [*from_family.targets(source, stem).values(), source])
    given = given_parts(deck, given_settings, cards)
    parts, warnings = _read(from_family, source, given, to_deck=isinstance(to_family, DeckFamily))
    complain_of(warnings)
    if control_sigma:
        parts, count = with_control_sigmas(parts, control_sigma)
        tell(f"sigmas {', '.join(f'{sigma:g}' for sigma in control_sigma)} m: {count_of(count, 'control point')}")
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
    if rendered.lacks:
        complain(f"{name_of(target)} will not run as it stands; it lacks:")
        for line in rendered.lacks:
            complain(f"- {line}")
        ctx.exit(_WILL_NOT_RUN)


def _read(
    family: FormatFamily, source: Path, given: Tables, *, to_deck: bool
) -> tuple[Tables, tuple[Problem, ...]]:
    """Return the parts of files and warnings. Raises `DeckError`, for a deck with all that `given` lacks too."""
    from musatpy.formats.parts import missing_parts

    try:
        return family.read(source, given)
    except DeckError as error:
        texts = " ".join(problem.message for problem in error.problems)
        lacks = missing_parts(given) if to_deck and "--" in texts else []
        further = [lack for lack in lacks if lack.message.partition(": ")[2] not in texts]
        raise DeckError([*error.problems, *further]) from error


def _camera_cards(texts: Sequence[str]) -> list[str]:
    """Return the cards of cameras, each NAME=FOCAL or NAME=FOCAL,X,Y in mm, or a table of them."""
    from musatpy.formats.cards.manual import card_of
    from musatpy.formats.cards.settings import SettingError, setting_of
    from musatpy.formats.job_tables import card_family
    from musatpy.keypunch.typed import cards_of_table

    family, cards = card_family(), list[str]()
    spec = family.cards["CAM"]
    for text in texts:
        name, equals, numbers = text.partition("=")
        if not equals:
            cards += cards_of_table(Path(text), spec, family)
            continue
        values = [name, *numbers.split(",")]
        with options.usage_errors(SettingError, "--camera"):
            settings = [setting_of(spec, *field) for field in zip(_CAMERA, values, strict=False)]
        card, problems = card_of(spec, settings, family)
        wrong = [problem.message for problem in problems if problem.severity == "error"]
        if wrong or len(values) not in (2, 4):
            raise click.UsageError(f"--camera {text}: {', '.join(wrong) or 'not NAME=FOCAL or NAME=FOCAL,X,Y'}")
        cards.append(card)
    return cards


def _family(
    known: Mapping[str, FormatFamily], path: Path, name: str | None, option: str, *, is_target: bool
) -> FormatFamily:
    """Return the family of a name, or the first whose files are named like `path`; raises `click.UsageError`."""
    if name is not None:
        if name not in known:
            raise click.UsageError(f"{option}: no family '{printable(name)}'; there are {', '.join(known)}")
        return known[name]
    if not (is_target and path.is_dir()):
        for family in known.values():
            if family.matches(path):
                return family
    patterns = "; ".join(f"{family.name} {' '.join(family.patterns)}" for family in known.values())
    raise click.UsageError(f"{name_of(path)}: give its family with {option} ({patterns})")
