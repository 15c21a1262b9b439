"""Decks with something wrong in them, by chance: what becomes of the run.

A run that ends in "unexpected" has a fault, and so has one that calls an answer good that cannot be one, or takes
too long; `drivers.fuzzing` runs them by the thousand.
"""

import re
import signal
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from drivers.fuzzing import cpu_limit
from musatpy.cli.main import main as musat
from record_rows import read_rows

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "fixtures"
CPU = 10.0  # seconds that a run may take
_PATIENCE = 60.0  # seconds until one is stopped
_LAST = 72  # columns of a card that are read
_ODD_NUMBERS = ("1E300", "-1E300", "1E30", "1E-300", "9999999999", "NAN", "INF", "-INF", "1E400")
_RAW_TEXTS = ("unexpected", "Traceback", "RuntimeWarning", "SVD", "ingular matrix", "LAPACK", "numpy", "scipy")

Cards = list[str]
Mutation = Callable[[Cards, np.random.Generator], Cards]


def _deck(name: str, *edits: tuple[str, str]) -> Cards:
    """Return the cards of a fixture, in which each `old` text becomes the `new` one."""
    text = (FIXTURES / name).read_text(encoding="ascii")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return text.splitlines()


def _more(options: str) -> tuple[str, str]:
    """Return the edit that adds an OP2 card."""
    return "\nWTR", f"\nOP2 {options}\nWTR"


_IIIA = ("OPT IIA  GEOG WATPT   ", "OPT IIIA GEOG RIGOROUS")
_DRY = ("  B  ", "     ")
_TIES = (
    "\nEND",
    "\nEQL A         9.9000 204      103\nBAS 21       22         1424.4700   0.0500"
    "\nDIS 204      205         1108.3400   0.1000\nHDF 204      205          -30.2200   0.1000\nEND",
)


@cache
def decks() -> dict[str, Cards]:
    """Return the small decks that are mutated: all programs, systems and options, each in a deck that runs fast."""
    st_thomas, local = "st_thomas/st_thomas.crd", "verdict/iia_same_deck.crd"
    return {
        "watpt": _deck(st_thomas),
        "rigorous": _deck(st_thomas, ("GEOG WATPT   ", "GEOG RIGOROUS")),
        "simultaneous": _deck(st_thomas, _IIIA),
        "ties": _deck(st_thomas, _IIIA, _TIES),
        "edit": _deck(st_thomas, _more(f"{'':43}EDIT")),
        "list": _deck(st_thomas, _IIIA, _more(f"{'':43}LIST")),
        "compute": _deck(st_thomas, _more("COMPUTE")),
        "check": _deck(st_thomas, _IIIA, _more("CHECK")),
        "free": [
            card for card in _deck(st_thomas, _IIIA, _more(f"{'':35}FREE"), _DRY) if card[:3] not in ("CTG", "EQL")
        ],
        "index": _deck(
            st_thomas, _IIIA, ("WTR 1.340000         ", "WTR 1.340000  0.00500"), _more(f"{'':28}ADJUST")
        ),
        "level": _deck(st_thomas, _IIIA, _more(f"{'':15}PHOTO"), ("0.1200        ", "0.1200  0.1000")),
        "utm": _deck("st_thomas_utm/st_thomas_utm.crd"),
        "raw": _deck("st_thomas_raw/st_thomas_raw.crd"),
        "two photos": _deck("bad_decks/good.crd"),
        "waves": _deck("waves/strip.crd"),
        "unknown waves": _deck("waves/unknown.crd"),
        "local": _deck(local),
        "local simultaneous": _deck("verdict/iiia_false_minimum.crd"),
        "in feet": _deck("verdict/control_in_feet.crd"),
    }


@cache
def large_decks() -> dict[str, Cards]:
    """Return decks that are checked only: other cards, more of them, and what they warn of."""
    names = ("cayman/cayman_modified", "cayman/cayman_standard", "bad_decks/many_errors", "orientation/strip")
    return {name: _deck(f"{name}.crd") for name in names}


def _places(cards: Cards, rng: np.random.Generator, pattern: str = r"\S+") -> tuple[int, int, int]:
    """Return card, first and last column (from 0, the last excluded) of some text after the mnemonic.

    Kinds of cards are taken as often as one another half the time, else as often as they are in the deck. Raises
    `ValueError` where no card has such a text.
    """
    places: dict[str, list[tuple[int, int, int]]] = {}
    for row, card in enumerate(cards):
        spans = [match.span() for match in re.finditer(pattern, card[:_LAST]) if match.start() > 3]
        places.setdefault(card[:3], []).extend((row, *span) for span in spans)
    kinds = [kind for kind in places.values() if kind]
    if not kinds:
        raise ValueError
    every = [place for kind in kinds for place in kind]
    choice = kinds[int(rng.integers(len(kinds)))] if rng.random() < 0.5 else every
    return choice[int(rng.integers(len(choice)))]


def _put(cards: Cards, row: int, first: int, last: int, text: str) -> Cards:
    """Return the cards with a text in the place of another, right-justified in its columns and those before it."""
    card, width = cards[row], last - first
    if len(text) > width:
        space = len(card[4:first]) - len(card[4:first].rstrip())
        first = max(first - space, last - len(text))
    return [*cards[:row], card[:first] + text.rjust(last - first) + card[last:], *cards[row + 1 :]]


def _digit(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, last = _places(cards, rng, r"\d")
    return _put(cards, row, first, last, str((int(cards[row][first]) + int(rng.integers(1, 10))) % 10))


def _sign(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, last = _places(cards, rng, r"-?[\d.]+")
    text = cards[row][first:last]
    return _put(cards, row, first, last, text[1:] if text[0] == "-" else f"-{text}")


def _point(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, last = _places(cards, rng, r"-?\d*\.\d+")
    text = cards[row][first:last]
    place, digits = text.index("."), text.replace(".", "")
    place = int(np.clip(place + rng.choice([-3, -1, 1, 3]), 0, len(digits)))
    return _put(cards, row, first, last, digits if rng.random() < 0.3 else f"{digits[:place]}.{digits[place:]}")


def _shift(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, _ = _places(cards, rng)
    card = cards[row]
    shifted = f"{card[:first]} {card[first:_LAST]}" if rng.random() < 0.5 else card[: first - 1] + card[first:_LAST]
    return [*cards[:row], shifted[:_LAST], *cards[row + 1 :]]


def _blank(cards: Cards, rng: np.random.Generator) -> Cards:
    return _put(cards, *_places(cards, rng), "")


def _zero(cards: Cards, rng: np.random.Generator) -> Cards:
    return _put(cards, *_places(cards, rng, r"-?[\d.]+"), "0")


def _zeros(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, last = _places(cards, rng, r"-?\d*\.\d+( +-?\d*\.\d+)+")
    return _put(cards, row, first, last, re.sub(r"[-\d.]", "0", cards[row][first:last]))


def _odd(cards: Cards, rng: np.random.Generator) -> Cards:
    return _put(cards, *_places(cards, rng, r"-?\d*\.\d+"), str(rng.choice(_ODD_NUMBERS)))


def _large(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, last = _places(cards, rng, r"-?\d+")
    return _put(cards, row, first, last, re.sub(r"\d", "9", cards[row][first:last]))


def _exchange(cards: Cards, rng: np.random.Generator) -> Cards:
    """Exchange the same columns of two cards, most often of one kind."""
    row, first, last = _places(cards, rng)
    alike = [n for n, card in enumerate(cards) if card[:3] == cards[row][:3] and n != row and len(card) >= last]
    if not alike:
        return cards
    other = int(rng.choice(alike))
    mine, its = cards[row][first:last], cards[other][first:last]
    return _put(_put(cards, row, first, last, its), other, first, last, mine)


def _within(cards: Cards, rng: np.random.Generator) -> Cards:
    """Exchange two numbers of a card."""
    row, first, last = _places(cards, rng, r"-?[\d.]+ +-?[\d.]+")
    one, gap, two = re.split(r"( +)", cards[row][first:last])
    return _put(cards, row, first, last, f"{two}{gap}{one}")


def _duplicate(cards: Cards, rng: np.random.Generator) -> Cards:
    row, place = (int(n) for n in rng.integers(len(cards), size=2))
    return [*cards[:place], cards[row], *cards[place:]]


def _lose(cards: Cards, rng: np.random.Generator) -> Cards:
    row, count = int(rng.integers(len(cards))), int(rng.choice([1, 1, 1, 2, 5]))
    return [*cards[:row], *cards[row + count :]]


def _swap(cards: Cards, rng: np.random.Generator) -> Cards:
    rows = list(range(len(cards)))
    one, other = (int(n) for n in rng.integers(len(cards), size=2))
    rows[one], rows[other] = other, one
    return [cards[row] for row in rows]


def _identity(cards: Cards, rng: np.random.Generator) -> Cards:
    """Take an identification from another card."""
    row, other = (int(n) for n in rng.integers(len(cards), size=2))
    columns = (4, 12) if rng.random() < 0.5 else (13, 21)
    return _put(cards, row, *columns, cards[other][slice(*columns)]) if len(cards[row]) > columns[1] else cards


@cache
def _codes() -> tuple[tuple[str, int, int, tuple[str, ...]], ...]:
    """Return mnemonic, columns and codes of the fields that have codes."""
    specs = [tomllib.loads(path.read_text()) for path in sorted((ROOT / "card_formats/musat").glob("*.toml"))]
    return tuple(
        (spec["mnemonic"], field["columns"][0] - 1, field["columns"][1], tuple(field["allowed"]))
        for spec in specs
        for field in spec.get("field", ())
        if "allowed" in field
    )


def _option(cards: Cards, rng: np.random.Generator) -> Cards:
    """Put another code into a field that has codes, on a card of the deck or a new OP2 card."""
    there = {card[:3] for card in cards} | {"OP2"}
    mnemonic, first, last, codes = [code for code in _codes() if code[0] in there][
        int(rng.integers(sum(code[0] in there for code in _codes())))
    ]
    rows = [n for n, card in enumerate(cards) if card[:3] == mnemonic]
    if not rows:
        cards, rows = [cards[0], mnemonic.ljust(80), *cards[1:]], [1]
    row = int(rng.choice(rows))
    card = cards[row].ljust(80)
    return [
        *cards[:row],
        card[:first] + str(rng.choice(codes)).ljust(last - first) + card[last:],
        *cards[row + 1 :],
    ]


def _control(cards: Cards, rng: np.random.Generator) -> Cards:
    row, first, _ = _places(cards, rng)
    return _put(cards, row, first, first + 1, chr(int(rng.choice([*range(10), *range(11, 32), 127, 155, 255]))))


def _truncate(cards: Cards, rng: np.random.Generator) -> Cards:
    row = int(rng.integers(len(cards)))
    return [*cards[:row], cards[row][: int(rng.integers(80))]]


MUTATIONS: dict[str, tuple[Mutation, float]] = {
    "digit": (_digit, 6.0),
    "sign": (_sign, 2.0),
    "point": (_point, 2.0),
    "shift": (_shift, 2.0),
    "blank": (_blank, 2.0),
    "zero": (_zero, 2.0),
    "zeros": (_zeros, 2.0),
    "odd": (_odd, 3.0),
    "large": (_large, 1.5),
    "exchange": (_exchange, 2.0),
    "within": (_within, 2.0),
    "duplicate": (_duplicate, 0.7),
    "lose": (_lose, 2.0),
    "swap": (_swap, 0.5),
    "identity": (_identity, 2.0),
    "option": (_option, 2.0),
    "control": (_control, 0.3),
    "truncate": (_truncate, 0.3),
}


@dataclass(frozen=True, kw_only=True)
class Run:
    """What became of a mutated deck."""

    seed: int
    deck: str
    mutations: tuple[str, ...]
    status: int
    grade: str  # of the verdict, empty where there is none
    seconds: float  # CPU
    faults: tuple[str, ...]


def mutated(seed: int) -> tuple[str, tuple[str, ...], bytes]:
    """Return the name of a deck, small or large, the mutations done to it, most often one, and its cards then."""
    rng = np.random.default_rng(seed)
    known = decks() | large_decks()
    name = list(known)[int(rng.integers(len(known)))]
    weights = np.array([weight for _, weight in MUTATIONS.values()])
    kinds = rng.choice(list(MUTATIONS), size=int(rng.choice([1, 1, 1, 2, 3])), p=weights / weights.sum())
    cards = known[name]
    for kind in kinds:
        try:
            cards = MUTATIONS[str(kind)][0](cards, rng)
        except ValueError:  # what it changes is on no card any more
            continue
    return name, tuple(str(kind) for kind in kinds), "".join(f"{card}\n" for card in cards).encode("latin-1")


def run(seed: int, folder: Path) -> Run:
    """Return what becomes of the deck of a seed, checked, and run if it is small, in `folder`."""
    name, kinds, cards = mutated(seed)
    path = folder / "job.crd"
    path.write_bytes(cards)
    for left in folder.glob("job.[lj]*"):
        left.unlink()
    signal.signal(signal.SIGVTALRM, _stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, _PATIENCE)
    start = time.process_time()
    try:
        with cpu_limit(2.0 * _PATIENCE):  # what is at work outside Python hears of no signal
            checked = CliRunner().invoke(musat, ["check", str(path)])
            runs = name in decks()
            result = CliRunner().invoke(musat, ["run", str(path)]) if runs else checked
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    seconds = time.process_time() - start
    faults = []
    if runs and checked.exit_code == 1 and result.exit_code != 1:
        faults.append(f"has errors by check, and runs with status {result.exit_code}")
    faults += [f"check says {text}: {_line(checked.output, text)}" for text in _RAW_TEXTS if text in checked.output]
    if checked.exit_code not in (0, 1):
        faults.append(f"check ends with {checked.exit_code}, {checked.exception!r}")
    faults += [f"says {text}: {_line(result.output, text)}" for text in _RAW_TEXTS if text in result.output]
    if result.exit_code not in range(5) or (result.exception and not isinstance(result.exception, SystemExit)):
        faults.append(f"ends with {result.exit_code}, {result.exception!r}")
    record = folder / "job.json"
    grade = ""
    if record.exists():
        values = read_rows(record)
        grade = values["verdict"]["grade"]
        if grade in ("ACCEPTED", "DOUBTFUL"):
            faults += absurdities(values)
    return Run(
        seed=seed,
        deck=name,
        mutations=kinds,
        status=result.exit_code,
        grade=grade,
        seconds=seconds,
        faults=tuple(faults),
    )


def _stop(*_: Any) -> None:
    raise TimeoutError


def _line(output: str, text: str) -> str:
    return next(line for line in output.splitlines() if text in line)[:300]


def absurdities(record: dict[str, Any]) -> list[str]:
    """Return what no answer can be in the record of a run."""
    stations, points = record["stations"], [one for one in record["points"] if one["status"] == "triangulated"]
    busy = {plate["photo"] for plate in record["plates"] if plate["triangulated"]}
    faults = []
    used = [station for station in stations if station["photo"] in busy]
    for what, rows in (("photo", used), ("point", points)):
        for row in rows:
            numbers = [*row["position"], *row.get("attitude", ()), *np.ravel(row["covariance"]).tolist()]
            if not all(isinstance(number, float) and np.isfinite(number) for number in numbers):
                faults.append(f"{what} {row[what]} has no finite numbers")
    return faults or _places_of(record, stations, points, busy)


def _places_of(record: dict[str, Any], stations: Any, points: Any, busy: set[str]) -> list[str]:
    """Return the stations below ground or far off, the points behind a camera or far off, and absurd sigmas."""
    system = record["options"]["system"]
    stations = [one for one in stations if one["photo"] in busy]
    camera = _enu(np.array([one["position"] for one in stations]), system)
    ground = _enu(np.array([one["position"] for one in points]), system)
    if system == "GEOC":
        centre = np.array([one["position"] for one in stations]).mean(axis=0)
        camera, ground = _upright(camera, centre), _upright(ground, centre)
    height = float(np.median(camera[:, 2]) - np.median(ground[:, 2]))
    size = max(height, float(np.ptp(camera[:, :2], axis=0).max()))
    number = {one["photo"]: n for n, one in enumerate(stations)}
    place = {one["point"]: n for n, one in enumerate(points)}
    faults = []
    if height <= 0.0:
        faults.append("stations under ground")
    middle = np.median(np.concatenate([camera, ground]), axis=0)
    for what, names, xyz in (("photo", list(number), camera), ("point", list(place), ground)):
        for name, distance in zip(names, np.linalg.norm(xyz - middle, axis=1), strict=True):
            if distance > 10.0 * size:
                faults.append(f"{what} {name} is {distance:.0f} m away, in a block of {size:.0f} m")
    for plate in record["plates"]:
        if not plate["triangulated"] or plate["point"] not in place or plate["photo"] not in number:
            continue
        omega, phi, _ = stations[number[plate["photo"]]]["attitude"]
        axis = np.array([np.sin(phi), -np.cos(phi) * np.sin(omega), np.cos(phi) * np.cos(omega)])
        ray = ground[place[plate["point"]]] - camera[number[plate["photo"]]]
        if axis @ ray > 0.0:
            faults.append(f"point {plate['point']} is behind photo {plate['photo']}")
    for what, rows in (("photo", stations), ("point", points)):
        for row in rows:
            sigma = np.sqrt(np.maximum(np.diagonal(np.array(row["covariance"], dtype=float)), 0.0))[:3]
            if sigma.max() > size:
                faults.append(f"{what} {row[what]} has a sigma of {sigma.max():.3g} m, in a block of {size:.0f} m")
            if what == "photo" and sigma.min() < 1e-6:
                faults.append(f"{what} {row[what]} has a sigma of {sigma.min():.3g} m")
    return faults


def _enu(position: np.ndarray, system: str) -> np.ndarray:
    """Return positions (k, 3) in metres, roughly, those of geographic jobs east, north, up."""
    if system != "GEOG":
        return position
    latitude, longitude, height = position.T
    radius = 6.37e6
    middle = np.median(latitude) if len(latitude) else 0.0
    return np.stack([radius * longitude * np.cos(middle), radius * latitude, height], axis=1)


def _upright(position: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Return geocentric positions (k, 3) east, north, up of a centre, roughly."""
    up = centre / np.linalg.norm(centre)
    east = np.cross([0.0, 0.0, 1.0], up) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], up))
    return (position - centre) @ np.stack([east, np.cross(up, east), up]).T
