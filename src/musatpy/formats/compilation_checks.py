"""What is wrong between the cards of a compilation deck, or with values that are well written."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from musatpy.arrays import IntArray, TextArray
from musatpy.errors import Problem, ProblemsError
from musatpy.formats import mapping
from musatpy.formats.cards.deck import CardDeck, CardTable
from musatpy.formats.compilation_cards import (
    CORNERS,
    LEVELS,
    READINGS,
    TIMES,
    cards_of,
    number,
    numbers,
    problem,
    text,
)
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, CoordinateSystem
from musatpy.model.compilation import IN_PROFILE

ModelFaults = Callable[[str, str], Sequence[tuple[str, str]]]

_POSITIVE = {
    "MDL": ("pointing", "limit"),
    "STG": ("sigma",),
    "MPT": ("sigma",),
    "CIN": ("interval", "index", "longest_edge"),
    "PRF": ("step", "spike", "spacing"),
    "GRD": ("spacing",),
    "PTM": ("first",),
}
_NO_FILE = re.compile(r"[/\\:*?\"<>|]|\.$")  # on any system; a name that ends with a point is no suffix
_INDEX_DIGITS = 5e-7  # of the index on a WTR card


def cross_checks(deck: CardDeck, run: Block | None, model_faults: ModelFaults | None) -> Iterator[Problem]:
    """Yield every problem; of what the deck says of a run, where that is known.

    `model_faults` says of a left and a right photo, field by field of MDL cards, why they make no model of the run.
    """
    for mnemonic, names in _POSITIVE.items():
        table = cards_of(deck, mnemonic)
        for name in names:
            for row in np.flatnonzero(number(table, name) <= 0.0).tolist():
                yield problem(deck, table, row, name, "not greater than zero")
    yield from _models(deck, model_faults)
    yield from _profiles(deck)
    yield from _ends_of_profiles(deck)
    yield from _times(deck)
    yield from _grids(deck)
    yield from _contours(deck)
    yield from _readings(deck)
    yield from _of_run(deck, run)
    yield from _datum(deck, run)
    if run is not None and run.options.system is CoordinateSystem.GEOCENTRIC:
        yield from _geocentric(deck)


def _models(deck: CardDeck, model_faults: ModelFaults | None) -> Iterator[Problem]:
    table = cards_of(deck, "MDL")
    ids, left, right = (text(table, name) for name in ("model", "left", "right"))
    for row in repeated([ids]):
        yield problem(deck, table, row, "model", f"model {ids[row]} is defined twice")
    for row, photos in enumerate(zip(left.tolist(), right.tolist(), strict=True)):
        if photos[0] == photos[1]:
            yield problem(deck, table, row, "right", f"model {ids[row]} has one photo on both stages")
        elif model_faults is not None and all(photos):
            for field, message in model_faults(*photos):
                yield problem(deck, table, row, field, f"model {ids[row]}: {message}")


def _profiles(deck: CardDeck) -> Iterator[Problem]:
    """Yield profiles in no model, named twice, without both ends, or of fewer than two readings."""
    table, models = cards_of(deck, "PRF"), text(cards_of(deck, "MDL"), "model")
    of, ids, ends = text(table, "model"), text(table, "profile"), cards_of(deck, "PRE")
    for row in repeated([of, ids]):
        yield problem(deck, table, row, "profile", "a second profile of this name in the model")
    for row in np.flatnonzero(~np.isin(of, models)).tolist():
        yield problem(deck, table, row, "model", "there is no MDL card of this model")
    for row in np.flatnonzero((text(table, "scan") == "L") | (text(table, "scan") == "")).tolist():
        if np.isfinite(table.columns["spacing"][row]):
            yield problem(deck, table, row, "spacing", "a single line (scan L) has none")
    given = set(zip(text(ends, "model").tolist(), text(ends, "profile").tolist(), strict=True))
    read, points, kinds = (
        np.concatenate([text(cards_of(deck, name), field) for name in READINGS])
        for field in ("model", "point", "class")
    )
    for row, name in enumerate(zip(of.tolist(), ids.tolist(), strict=True)):
        here = read == of[row]
        for field in ("start", "end"):
            end = str(table.columns[field][row])
            if bool(end) == (name in given):
                message = "its ends stand on a PRE card too" if end else "its ends stand on no PRE card"
                yield problem(deck, table, row, field, message)
            elif end and here.any() and not ((points == end) & here & (kinds != IN_PROFILE)).any():
                yield problem(deck, table, row, field, f"point {end} is not read in model {of[row]}")
        count = int(np.count_nonzero(here & (points == ids[row]) & (kinds == IN_PROFILE)))
        if here.any() and count < 2:
            readings = "1 reading" if count == 1 else f"{count} readings"
            message = f"profile {ids[row]} has {readings} of class P in model {of[row]}, and needs two"
            yield problem(deck, table, row, "profile", message)


def _ends_of_profiles(deck: CardDeck) -> Iterator[Problem]:
    table, profiles = cards_of(deck, "PRE"), cards_of(deck, "PRF")
    names = [text(table, name) for name in ("model", "profile")]
    known = set(zip(*(text(profiles, name).tolist() for name in ("model", "profile")), strict=True))
    for row, name in enumerate(zip(*(column.tolist() for column in names), strict=True)):
        if name not in known:
            yield problem(deck, table, row, "profile", "there is no PRF card of this profile")
    for row in repeated(names):
        yield problem(deck, table, row, "profile", "a second card of the ends of this profile")
    places = numbers(table, CORNERS)
    for row in np.flatnonzero((places[:, :2] == places[:, 2:]).all(axis=1)).tolist():
        yield problem(deck, table, row, "second_1", "both ends are in one place")


def _times(deck: CardDeck) -> Iterator[Problem]:
    """Yield times of readings that are not there, or that have one."""
    table, counts = cards_of(deck, "PTM"), dict[tuple[str, str], int]()
    seen: set[tuple[str, str, int]] = set()
    for mnemonic in READINGS:
        read = cards_of(deck, mnemonic)
        for model, name, kind in zip(*(text(read, n).tolist() for n in ("model", "point", "class")), strict=True):
            counts[model, name] = counts.get((model, name), 0) + (kind == IN_PROFILE)
    given = np.isfinite(numbers(table, TIMES))
    for row, (model, name) in enumerate(zip(*(text(table, n).tolist() for n in ("model", "profile")), strict=True)):
        first = table.columns["first"][row]
        count = counts.get((model, name), 0)
        if not first > 0.0:  # said already
            continue
        rows = [(model, name, int(first) + place) for place in np.flatnonzero(given[row]).tolist()]
        if rows[-1][2] > count:
            message = f"reading {rows[-1][2]} of profile {name} in model {model}, which has {count}"
            yield problem(deck, table, row, "first", message)
        if seen & set(rows):
            yield problem(deck, table, row, "first", "a second time of a reading")
        seen |= set(rows)


def _grids(deck: CardDeck) -> Iterator[Problem]:
    grids = cards_of(deck, "GRD")
    for row in repeated([text(grids, "name")]):
        yield problem(deck, grids, row, "name", "a second grid of this name")
    for row, name in enumerate(text(grids, "name").tolist()):
        if strange := _NO_FILE.findall(name):
            yield problem(
                deck, grids, row, "name", f"names files of the grid, and no file has {strange[0]} in its name"
            )
    given = np.isfinite(numbers(grids, CORNERS))
    for row in np.flatnonzero(given.any(axis=1) & ~given.all(axis=1)).tolist():
        missing = CORNERS[int(np.argmin(given[row]))]
        yield problem(deck, grids, row, missing, "a grid has both corners, or none")


def _contours(deck: CardDeck) -> Iterator[Problem]:
    """Yield contours asked for twice, of nothing, or of a grid that there is not."""
    table, listed = cards_of(deck, "CIN"), cards_of(deck, "CIL")
    of = of_contours(table)
    for row in repeated([of]):
        yield problem(deck, table, row, "of", "a second card of contours of this kind")
    for row in np.flatnonzero(np.isnan(number(table, "interval")) & ~np.isin(of, of_contours(listed))).tolist():
        yield problem(deck, table, row, "interval", "neither an interval nor a CIL card")
    for row in np.flatnonzero(~np.isin(of_contours(listed), of)).tolist():
        yield problem(deck, listed, row, "of", "there is no CIN card of this kind")
    grids = text(cards_of(deck, "GRD"), "name")
    for row, grid in enumerate(text(table, "grid").tolist()):
        if grid and grid not in grids:
            yield problem(deck, table, row, "grid", "there is no GRD card of this grid")
        for field in ("grid", "drying"):
            if of[row] == "H" and str(table.columns[field][row]) not in ("", "nan"):
                yield problem(deck, table, row, field, "contours of height have none")
    for row in np.flatnonzero(_holes(listed)).tolist():
        yield problem(deck, listed, row, LEVELS[0], "levels stand one beside the other, without a gap")


def of_contours(table: CardTable) -> TextArray:
    """Return of what contours are (k,), D or H."""
    of = text(table, "of")
    return np.where(of == "", "D", of)


def _holes(table: CardTable) -> IntArray:
    given = np.isfinite(numbers(table, LEVELS))
    return np.asarray((np.diff(given.astype(int), axis=1) > 0).any(axis=1))


def _readings(deck: CardDeck) -> Iterator[Problem]:
    """Yield readings in no model, and points that are read twice in one."""
    tables, models = [cards_of(deck, name) for name in READINGS], text(cards_of(deck, "MDL"), "model")
    of, points, kinds = (
        np.concatenate([text(table, name) for table in tables]) for name in ("model", "point", "class")
    )
    faults = [
        (row, "model", f"there is no MDL card of model {of[row]}")
        for row in np.flatnonzero(~np.isin(of, models)).tolist()
    ]
    single = np.flatnonzero(kinds != IN_PROFILE)
    faults += [
        (row, "point", f"point {points[row]} is read twice in model {of[row]}")
        for row in single[repeated([of[single], points[single]])].tolist()
    ]
    first = len(tables[0])
    for row, field, message in faults:
        table, place = (tables[0], row) if row < first else (tables[1], row - first)
        yield problem(deck, table, place, field, message)


def _of_run(deck: CardDeck, run: Block | None) -> Iterator[Problem]:
    """Yield what the deck says of water and ellipsoid, and the run otherwise."""
    water, earth = cards_of(deck, "WTR"), cards_of(deck, "ELL")
    if run is None:
        return
    for field in ("tilt_east", "tilt_north", "tilt_sigma", "sigma"):
        for row in np.flatnonzero(np.isfinite(number(water, field))).tolist():
            yield problem(deck, water, row, field, "the deck of the run says it: here the index is checked alone")
    for row, index in enumerate(number(water, "index").tolist()):
        known = None if run.water is None else run.water.index
        if known is None or abs(index - known) > _INDEX_DIGITS:
            water_of_run = "no water" if known is None else f"water of the index {known:.6f}"
            yield problem(deck, water, row, "index", f"the run has {water_of_run}")
    for row in range(len(earth)):
        if message := _other_ellipsoid(earth, row, run):
            yield problem(deck, earth, row, "name", message)


def _other_ellipsoid(table: CardTable, row: int, run: Block) -> str:
    """Return how an ellipsoid is another one than that of the run, nothing where it is not."""
    if run.options.system is CoordinateSystem.LOCAL or run.ellipsoid is None:
        return "the run is a local job, on no ellipsoid"
    try:
        spec = mapping.single_of("ellipsoid", mapping.gather(table.spec, table.columns), row)
        same = Ellipsoid.of(spec).has_axes(*Ellipsoid.of(run.ellipsoid).axes)
    except ValueError as error:
        return str(error)
    return "" if same else "the run is on another ellipsoid"


def _datum(deck: CardDeck, run: Block | None) -> Iterator[Problem]:
    """Yield the vertical grid of a sounding datum that cannot be used."""
    table = cards_of(deck, "VDT")
    for row, name in enumerate(text(table, "geoid").tolist()):
        if not name:
            continue
        if run is not None and run.options.system is CoordinateSystem.LOCAL:
            yield problem(deck, table, row, "geoid", "the run is a local job, and no grid of heights reaches it")
            continue
        from musatpy.geometry.projected import Geoid  # PROJ, for few decks

        try:
            Geoid(name)
        except ProblemsError as error:
            yield problem(deck, table, row, "geoid", error.problems[0].message)


def _geocentric(deck: CardDeck) -> Iterator[Problem]:
    """Yield places by two coordinates of a geocentric job, which has three."""
    grids, ends = cards_of(deck, "GRD"), cards_of(deck, "PRE")
    for row in np.flatnonzero(np.isfinite(numbers(grids, CORNERS)).any(axis=1)).tolist():
        yield problem(deck, grids, row, "first_1", "X and Y of a geocentric job are no place: leave corners blank")
    for row in np.flatnonzero(text(ends, "system") == "J").tolist():
        yield problem(deck, ends, row, "system", "X and Y of a geocentric job are no place: give the model's")


def repeated(columns: Sequence[TextArray]) -> list[int]:
    """Return the rows that are like one before them."""
    rows = np.stack(columns, axis=1) if len(columns) > 1 else columns[0][:, None]
    _, first = np.unique(rows, axis=0, return_index=True)
    again: IntArray = np.setdiff1d(np.arange(len(rows)), first)
    return [int(row) for row in again]
