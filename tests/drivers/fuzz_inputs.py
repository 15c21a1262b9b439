"""Inputs that are spoilt, through the commands that read them: what ends in anything but an answer or a message.

`drivers.fuzzing` makes them by the thousand.
"""

import json
import random
import re
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from click.testing import CliRunner

from drivers.fuzzing import cpu_limit
from musatpy.cli.main import main
from musatpy.runs import run_deck

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "fixtures"
SECONDS = 10.0  # of CPU for a case
_PAIR = f"--cameras {FIXTURES}/sea/cameras.csv --index 1.34"
_LAGOON = "--focal 152.4 --format 228.6,228.6 --index 1.3398"
_MODEL = "--index 1.34 --depths 5"
_CONTROL = "\x1b[2J\x07\x9b31m\u202e"
_NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e999",
    "9" * 400,
    "0",
    "-0.0",
    "1e-320",
    "1_000",
    "-1",
    "2.5",
)
_JSON = ('"\\u001b[2J"', '""', '"x"', "[]", "{}", "true", "[1, [2]]", "[" * 3000 + "]" * 3000, '"../x"')
_VALUES = (*_NUMBERS, *_JSON)
_NODES: tuple[Any, ...] = (
    *(None, True, 0, -1, 1e308, 10**400, float("nan"), float("inf"), "", _CONTROL, [], {}, [[1]]),
)


class Hang(BaseException):
    """A case that takes too long; no `except Exception` ends it."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """A file that is spoilt, and a command that reads it (`{}`; results go below `{out}`)."""

    name: str
    source: Path
    command: Sequence[str]
    beside: tuple[Path, ...] = ()  # files that are to stand in its folder
    weight: int = 10


@dataclass
class Tally:
    """What came of the cases."""

    cases: int = 0
    statuses: Counter[object] = field(default_factory=Counter)
    failures: list[tuple[str, int, str]] = field(default_factory=list)  # target, seed, what
    slowest: float = 0.0


def targets(made: Path) -> list[Target]:
    """Return the targets; records, agency files and baselines are made in a folder."""
    thomas, lagoon, sea = FIXTURES / "st_thomas", FIXTURES / "lagoon", FIXTURES / "sea"
    deck, listing = thomas / "st_thomas.crd", thomas / "st_thomas.lst"
    record, local = run_deck(deck, made).record, run_deck(FIXTURES / "verdict/iia_same_deck.crd", made).record
    assert record is not None and local is not None
    _run("convert", deck, made / "patb.im")
    _run("convert", deck, made / "giant.cnt")
    _run("convert", "--formats", FIXTURES / "own_formats/harbour", deck, made / "job.hbi")
    _run("sea", "fit", sea / "water.csv", "-o", made)
    _run("simulate", FIXTURES / "waves/unknown.toml", "-o", made)
    shutil.copy(deck, made / "base.crd")
    _run("baseline", "save", "-q", made / "base", made / "base.crd")
    clouds = [made / f"cloud.{kind}" for kind in ("las", "laz")] if _clouds(made) else []
    own = tuple(sorted((ROOT / "card_formats/musat").glob("*.toml")))
    harbour = tuple(sorted((FIXTURES / "own_formats/harbour").glob("*.toml")))
    bay = FIXTURES / "st_thomas_as11/st_thomas_as11.crd"
    manifest = made / "strips.toml"
    manifest.write_text(f'out = "here"\nbrief = true\n[[job]]\ndeck = "{deck}"\npunch = "result"\n')
    agency = [made / name for name in ("patb.im", "patb.ori", "giant.cnt", "giant.img") if (made / name).exists()]
    mapped, control = FIXTURES / "collocation/mapped.csv", FIXTURES / "collocation/control.csv"
    surface, places = made / "water.surface.json", FIXTURES / "groeneveld_meijer/table1.csv"
    depth = f"depth correct {{}} -o {{out}}/o{{suffix}} --jobs 1 --cameras {lagoon}/cameras.csv {_LAGOON}"
    rows: list[tuple[str, Path, str, int]] = [
        ("spec", thomas / "st_thomas.toml", "simulate {} -o {out}", 10),
        ("wave spec", FIXTURES / "waves/bay.toml", "waves {} -o {out}", 3),
        *(("cards", one, f"check {deck} --formats {{folder}}", 1) for one in own),
        *(
            ("formats", one, f"convert --formats {{folder}} {made}/job.hbi {{out}}/o.hbs --to {{name}}", 10)
            for one in harbour
        ),
        ("compare", record, f"compare {{}} {record}", 15),
        ("against", record, f"audit {listing} --against {{}}", 10),
        ("stations", local, f"depth table --cameras {{}} {_MODEL}", 10),
        ("sea record", local, "sea fit {} -o {out}", 10),
        ("points record", local, "sea interpolate {} {} -o {out}/o.csv", 10),
        ("diff record", record, f"diff {{}} {record}", 5),
        ("diff", listing, f"diff {{}} {listing}", 5),
        ("audit", listing, "audit {}", 6),
        ("scan", FIXTURES / "legacy/etl0306_table_6_5.lst", "audit {}", 15),
        ("rules", thomas / "st_thomas.diff.toml", f"diff --rules {{}} {listing} {listing}", 10),
        ("cameras", lagoon / "cameras.csv", f"depth table --cameras {{}} {_MODEL}", 10),
        ("points", lagoon / "points.csv", depth, 10),
        ("places", places, "depth table --height 2500 --base 1126 --index 1.35 --at {}", 10),
        ("water", sea / "water.csv", "sea fit {} -o {out}", 2),
        ("surface", surface, f"sea correct {sea}/bottom.csv -o {{out}}/o.csv --surface {{}} {_PAIR}", 10),
        ("bottom", sea / "bottom.csv", f"sea correct {{}} -o {{out}}/o.csv --surface {surface} {_PAIR}", 10),
        ("control", control, f"sea interpolate {mapped} {{}} -o {{out}}/o.csv --function gaussian", 3),
        *(("cloud", one, depth, 10) for one in clouds),
        *(("agency", one, f"convert --deck {deck} {{}} {{out}}/o.crd", 10) for one in agency),
        ("stages", bay, f"as11 compile {record} {{}} -o {{out}}", 6),
        (
            "soundings",
            bay.with_name("soundings.csv"),
            f"as11 compare-soundings {record} {bay} {{}} -o {{out}} --plan-sigma 1",
            4,
        ),
        ("orientation", FIXTURES / "orientation/tank.crd", "orient {} -o {out}", 10),
        ("inquiry", record, "explain 206 {}", 10),
        ("page", record, "report {} -o {out}/o.html", 3),
        ("manifest", manifest, "batch -q -j 1 {}", 1),
        ("index", made / "base/baseline.json", "baseline list {folder}", 8),
    ]
    beside = {"cards": own, "formats": harbour}
    return [
        Target(name=name, source=source, command=command.split(), beside=beside.get(name, ()), weight=weight)
        for name, source, command, weight in rows
    ]


def _run(*arguments: object) -> None:
    ran = CliRunner().invoke(main, [str(one) for one in arguments])
    assert ran.exit_code == 0, ran.output


def _clouds(folder: Path) -> bool:
    """Write a LAS and a LAZ file of points over the lagoon; tell whether that is possible."""
    try:
        import laspy
    except ImportError:
        return False
    import numpy as np

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.system_identifier = np.full(3, 1e-3), "SCANNER"
    header.add_extra_dims([laspy.ExtraBytesParams(name="amplitude", type="u2", description="of the echo")])
    header.vlrs.append(laspy.VLR(user_id="someone", record_id=7, description="his", record_data=b"abc"))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = np.random.default_rng(1).uniform((0, 0, -15), (900, 900, 1), (50, 3)).T
    for kind in ("las", "laz"):
        cloud.write(folder / f"cloud.{kind}")
    return True


# --- how a file is spoilt ---


def spoilt(data: bytes, suffix: str, rng: random.Random) -> bytes:
    """Return the bytes of a file with some mistakes."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        ways = [_bytes, _lines, _numbers, _texts]
        if suffix == ".json":
            ways = [_node] * 6 + ways
        if suffix == ".toml":
            ways = [_value] * 4 + ways
        if suffix in (".las", ".laz"):
            ways = [_bytes, _header]
        data = rng.choice(ways)(data, rng)
    return data


def _bytes(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data) + 1)
    end = min(len(data), start + rng.choice((1, 1, 2, 8, 100, 5000)))
    noise = bytes(rng.randrange(256) for _ in range(rng.choice((1, 2, 10))))
    choices = (noise, b"", data[start:end] * 2, data[start:end] * 50, b"\0", b" " * 100_000, bytes(200))
    return data[:start] + rng.choice(choices) + data[rng.choice((start, end)) :]


def _header(data: bytes, rng: random.Random) -> bytes:
    place, width = rng.randrange(min(len(data), 700)), rng.choice((1, 2, 4, 8))
    value = rng.choice((b"\xff" * width, bytes(width), rng.randbytes(width), b"\x7f" * width))
    return data[:place] + value + data[place + width :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    first, second = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(4)
    if way == 0:
        del lines[first]
    elif way == 1:
        lines[first], lines[second] = lines[second], lines[first]
    elif way == 2:
        lines.insert(first, lines[second])
    else:
        lines[first] = lines[first].replace(b",", rng.choice((b";", b",,", b"")), 1)
    return b"\n".join(lines)


def _numbers(data: bytes, rng: random.Random) -> bytes:
    return _replaced(rb"-?\d+\.?\d*", data, rng.choice(_NUMBERS).encode(), rng)


def _texts(data: bytes, rng: random.Random) -> bytes:
    return _replaced(rb"[A-Za-z]+", data, rng.choice((_CONTROL, "é", "\u2028", "x" * 5000, "../x")).encode(), rng)


def _value(data: bytes, rng: random.Random) -> bytes:
    return _replaced(rb"(?<== )[^\n]+", data, rng.choice(_VALUES).encode(), rng)


def _replaced(pattern: bytes, data: bytes, new: bytes, rng: random.Random) -> bytes:
    places = [found.span() for found in re.finditer(pattern, data)]
    if not places:
        return data
    start, end = rng.choice(places)
    return data[:start] + new + data[end:]


def _node(data: bytes, rng: random.Random) -> bytes:
    """Return JSON with another value, or none, at a place of it."""
    try:
        content = json.loads(data)
    except ValueError:
        return data
    inner = content
    while isinstance(inner, dict | list) and inner:
        key = rng.choice(list(inner)) if isinstance(inner, dict) else rng.randrange(len(inner))
        below = inner[key]
        if isinstance(below, dict | list) and below and rng.random() < 0.85:
            inner = below
        elif rng.random() < 0.3:
            del inner[key]
            break
        else:
            inner[key] = [below, below] if rng.random() < 0.2 else rng.choice(_NODES)
            break
    return json.dumps(content).encode()


# --- what comes of it ---


def fuzz(
    count: int,
    seed: int,
    only: tuple[str, ...] = (),
    tell: Callable[[str], None] = print,
    begun: Callable[[int], None] = lambda case: None,
) -> Tally:
    """Return what came of so many cases; `begun` is told of each before."""
    tally = Tally()
    with TemporaryDirectory() as folder:
        made = Path(folder) / "made"
        made.mkdir()
        known = [one for one in targets(made) if not only or one.name in only]
        rng = random.Random(seed)
        for case in range(count):
            target = rng.choices(known, [one.weight for one in known])[0]
            begun(seed * 1_000_000 + case)
            fault = _case(target, Path(folder) / "case", seed * 1_000_000 + case, tally)
            if fault:
                tally.failures.append((target.name, seed * 1_000_000 + case, fault))
                tell(f"{target.name} {seed * 1_000_000 + case}: {fault}")
    return tally


def _case(target: Target, folder: Path, seed: int, tally: Tally) -> str:
    """Return what is wrong with the answer to a case; nothing where it is right."""
    rng = random.Random(seed)
    shutil.rmtree(folder, ignore_errors=True)
    given, out = folder / "given", folder / "out"
    given.mkdir(parents=True)
    out.mkdir()
    for path in target.beside:
        shutil.copy(path, given)
    file = given / target.source.name
    file.write_bytes(spoilt(target.source.read_bytes(), target.source.suffix, rng))
    before = set(folder.rglob("*"))
    words = {"out": out, "folder": given, "name": given.name, "suffix": file.suffix}
    arguments = [one.format(file, **words) for one in target.command]
    start = time.process_time()
    try:
        with _limited(SECONDS):
            ran = CliRunner().invoke(main, arguments)
    except Hang:
        return f"takes more than {SECONDS:.0f} s"
    tally.cases += 1
    tally.slowest = max(tally.slowest, time.process_time() - start)
    tally.statuses[ran.exit_code] += 1
    return next(_faults(ran.output, ran.exception, set(folder.rglob("*")) - before, folder), "")


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def end(number: int, frame: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        with cpu_limit(2.0 * seconds):  # what is at work outside Python hears of no signal
            yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _faults(text: str, error: BaseException | None, files: set[Path], folder: Path) -> Iterator[str]:
    if isinstance(error, Hang):
        yield f"takes more than {SECONDS:.0f} s"
    elif error is not None and not isinstance(error, SystemExit):
        yield f"ends in {type(error).__name__}: {error}"
    for word in ("unexpected", "please report it", "Traceback"):
        if word in text:
            line = next(line for line in text.splitlines() if word in line)
            yield f"says {line[-300:]}"
    raw = {one for one in text if not (one.isprintable() or one in "\n\t\f")}
    if raw:
        yield f"prints {raw!r}"
    outside = [path for path in files if not path.is_relative_to(folder / "out")]
    if outside and not any("batch" in path.name for path in outside):  # a manifest says where its results go
        yield f"writes {outside[0].relative_to(folder)}"
