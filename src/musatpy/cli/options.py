"""Groups of commands, and the arguments and options that several commands share."""

from __future__ import annotations

import datetime
import re
import shlex
from collections import UserDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import musatpy
from musatpy.cli.messages import LOG, QUIET, VERBOSE, log, name_of, tell
from musatpy.errors import CardFormatError, MissingPackageError, MusatError, printable

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from musatpy.formats.cards.settings import Setting
    from musatpy.formats.cards.spec import CardSpec, Family


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def _be_quiet(ctx: click.Context, param: click.Parameter, given: bool) -> bool:
    ctx.meta[QUIET] = given
    return given


def _be_verbose(ctx: click.Context, param: click.Parameter, given: bool) -> None:
    if given:
        ctx.meta[VERBOSE] = True
        click.echo(f"musat: {_begun(ctx)}", err=True)


def _begun(ctx: click.Context) -> str:
    return printable(f"version {musatpy.__version__}, {shlex.join(['musat', *ctx.meta[WORDS]])}")


def _open_log(ctx: click.Context, param: click.Parameter, path: Path | None) -> None:
    """Add to a log; a file that begins otherwise is none: a deck in the wrong place is not written to."""
    if path is None:
        return
    try:
        with path.open("a+", encoding="utf-8") as file:
            file.seek(0)
            if (start := file.read(20)) and not re.match(r"\d{4}-\d\d-\d\dT\d", start):
                raise click.BadParameter(f"{name_of(path)} is there, and is no log", ctx, param)
        ctx.meta[LOG] = ctx.find_root().with_resource(path.open("a", encoding="utf-8"))
    except OSError as error:
        raise click.BadParameter(f"{name_of(path)}: {error.strerror}", ctx, param) from error
    log(_begun(ctx))


WORDS = "musatpy.words"  # those of the command line, in the `meta` of a context
COMMON: list[click.Parameter] = [
    click.Option(
        ["-v", "--verbose"], is_flag=True, expose_value=False, callback=_be_verbose, help="Print phases on stderr."
    ),
    click.Option(
        ["--log"], metavar="FILE", type=click.Path(dir_okay=False, path_type=Path), expose_value=False,
        callback=_open_log, help="Append messages and phases to FILE, with the time.",
    ),
]  # fmt: skip


class LazyCommands(UserDict[str, Any]):
    """Commands by their names, each imported when asked for: from `module`, as its `command`, or `module:name`.

    Each has the options of all, unless it is a group.
    """

    def __getitem__(self, name: str) -> click.Command:
        """Return a command; raises `KeyError`."""
        command = super().__getitem__(name)
        if isinstance(command, str):
            module, _, attribute = command.partition(":")
            command = self[name] = getattr(import_module(module), attribute or "command")
        if not isinstance(command, click.Group) and COMMON[0] not in command.params:
            command.params += COMMON
        return command


class LazyGroup(click.Group):
    """Commands in the order in which they are stated: first `modules`, which are loaded when used, then its own."""

    def __init__(self, *args: Any, modules: Mapping[str, str] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.commands = LazyCommands(modules or {})

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the help page."""
        return list(self.commands)


@contextmanager
def usage_errors(kind: type[Exception] = MusatError, option: str = "") -> Iterator[None]:
    """Turn errors of a kind into those of a wrong command line, of an `option` where one is named."""
    try:
        yield
    except (MissingPackageError, CardFormatError):
        raise
    except kind as error:
        raise click.UsageError(f"{option and f'{option}: '}{printable(str(error))}") from error


class NamedPath(click.Path):
    """A path with a name: an empty one, of a variable that is not set, would be the folder in which we are."""

    def __init__(self, **more: Any) -> None:
        super().__init__(path_type=Path, **more)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; fails where the name is empty."""
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


def options_of(*options: Callable[..., Any]) -> Decorator:
    """Return a decorator that gives a command these options, in this order."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


FILE, FOLDER = NamedPath(), NamedPath(file_okay=False)
POSITIVE, NOT_NEGATIVE = click.FloatRange(min=0.0, min_open=True), click.FloatRange(min=0.0)


def option(
    stated: str, meaning: str, kind: Any = None, *, name: str = "", shown: Any = None, **more: Any
) -> Decorator:
    """Return an option as its help has it: `-o --out DIR`, what it means, and a default that is `shown`.

    `kind` is that of its value, and `name` that of its parameter, where it is not the last name of the option.
    """
    words = stated.split()
    names = [word for word in words if word.startswith("-")]
    value = " ".join(words[len(names) :]) or None
    if shown is not None:
        more |= {"default": shown, "show_default": True}
    return click.option(*names, *([name] if name else []), type=kind, metavar=value, help=meaning, **more)


def flag(stated: str, meaning: str, **more: Any) -> Decorator:
    """Return an option without a value."""
    return option(stated, meaning, is_flag=True, **more)


def picture_options(switch: str = "") -> Decorator:
    """Return a decorator that gives a command --format and --dpi, of which it gets the `form` of its pictures.

    They go with the option `switch` where only that makes pictures.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @option(
            "--format",
            "Format of the pictures. Default: the one that suits each of them.",
            click.Choice(["svg", "png", "pdf"]),
            name="image_kind",
        )
        @dpi_option
        @wraps(command)
        def with_form(*args: Any, image_kind: str | None, dpi: int, **given: Any) -> Any:
            from musatpy.figures import FORM, ImageForm

            form = ImageForm(kind=image_kind or "", dpi=dpi)
            if switch and not given[switch] and form != FORM:
                raise click.UsageError(f"--format and --dpi go with --{switch}")
            return command(*args, form=form, **given)

        return with_form

    return decorate


def page_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command --client and --operator, of which it gets the `particulars` at the top of its page, by label.

    So is the date, where it has one, and stays a parameter too.
    """

    @option("--client NAME", "Client; printed at the top of the page.", default="")
    @option("--operator NAME", "Operator; printed at the top of the page.", default="")
    @wraps(command)
    def with_lines(*args: Any, client: str, operator: str, **given: Any) -> Any:
        if (client or operator) and not given.get("html", True):
            raise click.UsageError("--client and --operator go with --html")
        date = f"{given['date']:%Y-%m-%d}" if given["date"] else ""
        every = {"Date": date, "Client": client, "Operator": operator}
        return command(*args, particulars={label: text for label, text in every.items() if text}, **given)

    return with_lines


def keys_option(spec: str) -> Decorator:
    """Return the option --keys, which lists the keys of a TOML file by its dataclass, named `module:name`."""

    def show(context: click.Context, _: click.Parameter, shown: bool) -> None:
        if shown:
            from musatpy.specs import key_tables

            module, name = spec.split(":")
            tell(key_tables(getattr(import_module(module), name)), nl=False)
            context.exit()

    return flag("--keys", "List the keys of SPEC.", is_eager=True, expose_value=False, callback=show)


def settings_for(texts: Sequence[str], family: Family) -> tuple[Setting, ...]:
    """Return what --set says of the cards of a family; raises `click.UsageError`."""
    from musatpy.formats.cards.settings import SettingError, settings_of

    with usage_errors(SettingError, "--set"):
        return settings_of(texts, family)


def refuse_overwriting(results: Iterable[Path], read: Iterable[Path]) -> None:
    """Raise `click.UsageError` where a result would go into a file that is read, behind links too."""
    from musatpy.files import real_path

    inputs = {real_path(path) for path in read}
    for path in results:
        if real_path(path) in inputs:
            raise click.UsageError(f"the result would overwrite {name_of(path)}, which is read")


def _coordinate_names(ctx: click.Context, param: click.Parameter, text: str) -> tuple[str, ...]:
    """Return three names with commas between them."""
    names = tuple(name.strip() for name in text.split(","))
    if len(names) != 3 or not all(names):
        raise click.BadParameter(f"three names are needed, not '{text}'", ctx, param)
    if len({name.lower() for name in names}) < 3:
        raise click.BadParameter(f"'{text}' has a name twice", ctx, param)
    return names


def columns_of(points: Path, columns: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the coordinates in a file; refuses other ones than its own for a file without names."""
    if columns != _COORDINATES and points.suffix.lower() in _NAMELESS:
        raise click.UsageError(f"--columns: coordinates in a file {points.suffix} have no other names")
    return columns


_COORDINATES = ("x", "y", "z")
# records of runs, clouds of points, rasters, and files of GIS and CAD
_NAMELESS = (".json", ".las", ".laz", ".tif", ".tiff", ".gpkg", ".geojson", ".dxf")


water_options = options_of(
    option("--water FILE", "Areas of water, or a shoreline (GeoJSON).", FILE),
    option("--water-side", "Side of a shoreline that is water.", click.Choice(["left", "right"])),
)


def crs_option(meaning: str) -> Decorator:
    """Return the option --crs, a coordinate system that has this meaning."""
    return option("--crs", meaning, default="")


columns_option = option(
    "--columns X,Y,Z",
    "Names of the coordinates in a CSV file.",
    shown=",".join(_COORDINATES),
    callback=_coordinate_names,
)


def quiet_as(meaning: str) -> Decorator:
    """Return the option -q, with which a problem is one line besides."""
    return flag("-q --quiet", meaning, callback=_be_quiet)


quiet_option = quiet_as("Print no progress and no summary.")
quiet_run_option = quiet_as("Print no progress and no summary, only errors and warnings, one line for each.")
decks_argument = click.argument("decks", metavar="DECK...", nargs=-1, required=True, type=FILE)
out_option = option("-o --out DIR", "Folder of the results. Default: that of the input.", FOLDER, name="out_dir")
carriage_control_option = flag(
    "--carriage-control", "Put ASA carriage control characters into column 1 of the listing."
)
csv_option = flag("--csv", "Also write the tables of the listing, as NAME_tables/TITLE.csv.")
date_option = flag(
    "--date",
    "Print today's date on every page.",
    callback=lambda ctx, param, dated: datetime.date.today() if dated else None,
)
warnings_option = flag(
    "--warnings", "Print warnings again that the last run of the same deck printed.", name="repeated"
)
strict_option = flag("--strict", "End with status 4 also if the answer is doubtful.")
anyway_option = flag("--anyway", "Use the run even if it has not converged; every page then says so.")


def offered(text: str, titles: Mapping[str, str]) -> list[CompletionItem]:
    """Return the names that a shell may complete a text to, with their titles."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(name, help=title or None) for name, title in titles.items() if name.startswith(text)]


def offered_fields(text: str, card: CardSpec, before: str = "") -> list[CompletionItem]:
    """Return the fields of a card that a shell may complete a text to; behind the sign of equality their words."""
    words = [f"{before}{field.name}={word}" for field in card.fields for word in field.allowed]
    names = [f"{before}{field.name}=" for field in card.fields]
    return offered(text, dict.fromkeys(words if "=" in text else names, ""))


def _settings_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the cards that --set may name, and behind the point the fields of a card."""
    from musatpy.formats.cards.settings import single_cards
    from musatpy.formats.job_tables import card_family

    cards = single_cards(card_family(ctx.params.get("formats")))
    mnemonic, point, field = text.partition(".")
    if not point:
        return offered(text.upper(), {f"{name}.": card.title for name, card in cards.items()})
    text = f"{mnemonic.upper()}.{field}"
    return [item for name, card in cards.items() for item in offered_fields(text, card, f"{name}.")]


formats_option = option(
    "--formats DIR",
    "Read the decks by the card formats (TOML) in this folder, a family of your own.",
    NamedPath(exists=True, file_okay=False),
)
set_option = option(
    "--set CARD.FIELD=VALUE",
    "Replace the value of a field for this run, for example OP2.water_level=ONE. Only cards that a deck has "
    "once; 'musat card' lists cards and fields.",
    name="settings",
    multiple=True,
    shell_complete=_settings_beginning,
)
dry_option = option(
    "--dry POLYGON",
    "Take the points inside the polygon of a file (GeoJSON, or lines of east and north) as certainly dry, as "
    "flag D does.",
    FILE,
)
submerged_option = option(
    "--submerged LIST|POLYGON|BELOW",
    "Flag points as submerged, as flag B does: the points named in a file, those inside a polygon "
    "(*.geojson, *.json, *.csv), or, with BELOW, those that a first adjustment finds below the water of all their "
    "photos.",
    FILE,
)
deck_option = option("-o --out OUT", "Deck to write; - is the standard output.", FILE, name="out", required=True)
dpi_option = option("--dpi", "Dots per inch of PNG pictures.", click.IntRange(30, 600), shown=110)


def listed_option(of: str, default: int = 20) -> Callable[[Any], Any]:
    """Return the option that says how many rows are shown of each section, or of something else."""
    about = f"Number of rows to show of each {of}."
    return option("--listed", about, click.IntRange(min=1), shown=default)


titles_option = option(
    "--title TEXT",
    "Line of the job title; replaces the titles of the decks. May be repeated.",
    name="titles",
    multiple=True,
)
record_option = option(
    "--record",
    "How much of NAME.json to write: full (default), tables (without those of images), or none.",
    click.Choice(["full", "tables", "none"]),
)
causes_option = option(
    "--causes",
    "How long a run that is not accepted searches for causes: usual for twice the work of its adjustment, "
    "all for eight times.",
    click.Choice(["usual", "all", "none"]),
)
processes_option = option(
    "-j --jobs N", "Number of processes. Default: the number of cores.", click.IntRange(min=1), name="processes"
)
