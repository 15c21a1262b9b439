"""What is wrong between the cards of a compilation deck, or with values that are well written."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from musatpy.arrays import TextArray
from musatpy.errors import Problem, ProblemsError
from musatpy.formats import mapping
from musatpy.formats.checks import references, values
from musatpy.formats.checks.references import repeats, unknown
from musatpy.formats.draft import Draft
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, CoordinateSystem
from musatpy.model.compilation import IN_PROFILE

ModelFaults = Callable[[str, str], Sequence[tuple[str, str]]]

READINGS = ("STG", "MPT")
_NO_FILE = re.compile(r"[/\\:*?\"<>|]|\.$")  # on any system; a name that ends with a point is no suffix
_INDEX_DIGITS = 5e-7  # of the index on a WTR card
_NAMED = (  # what cards name, which cards define it, and what is said where none does
    ("PRF", "profiles.model", "MDL", "models.ids", "there is no MDL card of this model"),
    ("STG", "stages.model", "MDL", "models.ids", "there is no MDL card of model {}"),
    ("MPT", "stages.model", "MDL", "models.ids", "there is no MDL card of model {}"),
    ("CIL", "contour_levels.of", "CIN", "contours.of", "there is no CIN card of this kind"),
    ("CIN", "contours.grid", "GRD", "grids.ids", "there is no GRD card of this grid"),
)
_WITHOUT = (  # what cards of a kind have not
    ("PRF", "profiles.spacing", "profiles.scan", "L", "a single line (scan L) has none"),
    ("CIN", "contours.grid", "contours.of", "H", "contours of height have none"),
    ("CIN", "contours.drying", "contours.of", "H", "contours of height have none"),
)
_OF_RUN = ("tilt_east", "tilt_north", "tilt_sigma", "sigma")  # of the water


def cross_checks(draft: Draft, run: Block | None, model_faults: ModelFaults | None) -> Iterator[Problem]:
    """Yield every problem; of what the deck says of a run, where that is known.

    `model_faults` says of a left and a right photo, field by field of MDL cards, why they make no model of the run.
    """
    for check in (values.bounds, references.repeated_cards):
        yield from check(draft)
    for role, path, other, name, message in _NAMED:
        yield from unknown(draft, role, path, draft.rows[other][name], message)
    for role, path, of, kind, message in _WITHOUT:
        given = draft.rows[role][path]
        wrong = (draft.rows[role][of] == kind) & (given == given) & (given != "")
        yield from draft.problems(role, wrong, message, path=path)
    for of_deck in (_profiles, _times, _grids, _contours, _readings):
        yield from of_deck(draft)
    yield from _models(draft, model_faults)
    yield from _datum(draft, run)
    if run is not None:
        yield from _of_run(draft, run)


def _models(draft: Draft, model_faults: ModelFaults | None) -> Iterator[Problem]:
    ids, left, right = (draft.rows["MDL"][f"models.{name}"].tolist() for name in ("ids", "left", "right"))
    for row, (name, *photos) in enumerate(zip(ids, left, right, strict=True)):
        faults: Sequence[tuple[str, str]] = ()
        if photos[0] == photos[1]:
            yield draft.problem("MDL", row, f"model {name} has one photo on both stages", path="models.right")
        elif model_faults is not None and all(photos):
            faults = model_faults(photos[0], photos[1])
        for field, message in faults:
            yield draft.problem("MDL", row, f"model {name}: {message}", path=f"models.{field}")


def _of_readings(draft: Draft) -> tuple[TextArray, TextArray, TextArray]:
    """Return model, name and class (k,) of the readings, those on the stages first."""
    model, name, kind = (
        np.concatenate([draft.rows[role][f"stages.{path}"] for role in READINGS])
        for path in ("model", "ids", "kind")
    )
    return model, name, kind


def _pairs(draft: Draft, role: str, table: str = "profiles") -> list[tuple[str, str]]:
    """Return model and profile of each card of a role."""
    model, name = (draft.rows[role][f"{table}.{path}"].tolist() for path in ("model", "ids"))
    return list(zip(model, name, strict=True))


def _profiles(draft: Draft) -> Iterator[Problem]:
    """Yield profiles without both ends, or of fewer than two readings, and ends of none, or in one place."""
    rows, given = draft.rows["PRF"], set(_pairs(draft, "PRE"))
    model, point, kind = _of_readings(draft)
    for row, (of, name) in enumerate(_pairs(draft, "PRF")):
        here = model == of
        for path in ("profiles.start", "profiles.end"):
            end = rows[path][row]
            if bool(end) == ((of, name) in given):
                message = "its ends stand on a PRE card too" if end else "its ends stand on no PRE card"
                yield draft.problem("PRF", row, message, path=path)
            elif end and here.any() and not ((point == end) & here & (kind != IN_PROFILE)).any():
                yield draft.problem("PRF", row, f"point {end} is not read in model {of}", path=path)
        count = int(np.count_nonzero(here & (point == name) & (kind == IN_PROFILE)))
        if here.any() and count < 2:
            readings = "1 reading" if count == 1 else f"{count} readings"
            message = f"profile {name} has {readings} of class P in model {of}, and needs two"
            yield draft.problem("PRF", row, message, path="profiles.ids")
    known, places = set(_pairs(draft, "PRF")), draft.rows["PRE"]["profiles.places"]
    nowhere = np.array([name not in known for name in _pairs(draft, "PRE")], dtype=bool)
    yield from draft.problems("PRE", nowhere, "there is no PRF card of this profile", path="profiles.ids")
    same = (places[:, :2] == places[:, 2:]).all(axis=1)
    yield from draft.problems("PRE", same, "both ends are in one place", path="profiles.places", component=2)


def _times(draft: Draft) -> Iterator[Problem]:
    """Yield times of readings that are not there, or that have one."""
    rows, seen = draft.rows["PTM"], set[tuple[str, str, int]]()
    counts = Counter(
        (model, name) for model, name, kind in zip(*_of_readings(draft), strict=True) if kind == IN_PROFILE
    )
    given = np.isfinite(rows["profile_times.time"])
    for row, (model, name) in enumerate(_pairs(draft, "PTM", "profile_times")):
        first, path = rows["profile_times.first"][row], "profile_times.first"
        if not first > 0.0:  # said already
            continue
        times = [(model, name, int(first) + place) for place in np.flatnonzero(given[row]).tolist()]
        if times[-1][2] > counts[model, name]:
            message = f"reading {times[-1][2]} of profile {name} in model {model}, which has {counts[model, name]}"
            yield draft.problem("PTM", row, message, path=path)
        if seen & set(times):
            yield draft.problem("PTM", row, "a second time of a reading", path=path)
        seen |= set(times)


def _grids(draft: Draft) -> Iterator[Problem]:
    rows = draft.rows["GRD"]
    for row, name in enumerate(rows["grids.ids"].tolist()):
        if strange := _NO_FILE.findall(name):
            message = f"is used in names of files, and no file can have {strange[0]} in its name"
            yield draft.problem("GRD", row, message, path="grids.ids")
    given = np.isfinite(np.concatenate([rows["grids.first"], rows["grids.second"]], axis=1))
    for row in np.flatnonzero(given.any(axis=1) & ~given.all(axis=1)).tolist():
        corner, component = divmod(int(np.argmin(given[row])), 2)
        path = ("grids.first", "grids.second")[corner]
        yield draft.problem("GRD", row, "a grid has both corners, or none", path=path, component=component)


def _contours(draft: Draft) -> Iterator[Problem]:
    """Yield contours of nothing, and levels with gaps."""
    rows, listed = draft.rows["CIN"], draft.rows["CIL"]
    nothing = np.isnan(rows["contours.interval"]) & ~np.isin(rows["contours.of"], listed["contour_levels.of"])
    yield from draft.problems("CIN", nothing, "neither an interval nor a CIL card", path="contours.interval")
    path, message = "contour_levels.levels", "levels stand one beside the other, without a gap"
    given = np.isfinite(listed[path]).astype(int)
    gaps = np.flatnonzero((np.diff(given, axis=1) > 0).any(axis=1))
    yield from draft.problems("CIL", gaps, message, path=path, component=0)


def _readings(draft: Draft) -> Iterator[Problem]:
    """Yield points that are read twice in a model."""
    model, point, kind = _of_readings(draft)
    single, first = np.flatnonzero(kind != IN_PROFILE), len(draft.rows[READINGS[0]])
    keys = (np.unique(texts[single], return_inverse=True)[1].reshape(-1) for texts in (model, point))
    for place, _ in repeats(*keys):
        row = int(single[place])
        role, of_role = (READINGS[0], row) if row < first else (READINGS[1], row - first)
        message = f"point {point[row]} is read twice in model {model[row]}"
        yield draft.problem(role, of_role, message, path="stages.ids")


def _of_run(draft: Draft, run: Block) -> Iterator[Problem]:
    """Yield what the deck says of water, ellipsoid and places, and the run otherwise."""
    water = draft.rows["WTR"]
    for path in (f"water.{name}" for name in _OF_RUN):
        message = "the deck of the run states it; here only the index is checked"
        yield from draft.problems("WTR", np.isfinite(water[path]), message, path=path)
    known = "no water" if run.water is None else f"water of the index {run.water.index:.6f}"
    index = water["water.index"]
    off = np.full(len(index), True) if run.water is None else np.abs(index - run.water.index) > _INDEX_DIGITS
    yield from draft.problems("WTR", off, f"the run has {known}", path="water.index")
    for row in range(len(draft.rows["ELL"])):
        if message := _other_ellipsoid(draft, row, run):
            yield draft.problem("ELL", row, message, path="ellipsoid.name")
    if run.options.system is CoordinateSystem.GEOCENTRIC:
        what = "X and Y alone are no place in a geocentric job"
        grids, of_job = draft.rows["GRD"], draft.rows["PRE"]["profiles.system"] == "J"
        given = np.isfinite(np.concatenate([grids["grids.first"], grids["grids.second"]], axis=1)).any(axis=1)
        yield from draft.problems("GRD", given, f"{what}: leave corners blank", path="grids.first", component=0)
        yield from draft.problems("PRE", of_job, f"{what}: give the model's", path="profiles.system")


def _other_ellipsoid(draft: Draft, row: int, run: Block) -> str:
    """Return how an ellipsoid is another one than that of the run, nothing where it is not."""
    if run.options.system is CoordinateSystem.LOCAL or run.ellipsoid is None:
        return "the run is a local job, on no ellipsoid"
    try:
        spec = mapping.single_of("ellipsoid", draft.rows["ELL"].values, row)
        same = Ellipsoid.of(spec).has_axes(*Ellipsoid.of(run.ellipsoid).axes)
    except ValueError as error:
        return str(error)
    return "" if same else "the run is on another ellipsoid"


def _datum(draft: Draft, run: Block | None) -> Iterator[Problem]:
    """Yield the vertical grid of a sounding datum that cannot be used."""
    for row, name in enumerate(draft.rows["VDT"]["datum.geoid"].tolist()):
        message = ""
        if name and run is not None and run.options.system is CoordinateSystem.LOCAL:
            message = "the run is a local job, and no grid of heights applies to it"
        elif name:
            from musatpy.geometry.projected import Geoid  # PROJ, for few decks

            try:
                Geoid(name)
            except ProblemsError as error:
                message = error.problems[0].message
        if message:
            yield draft.problem("VDT", row, message, path="datum.geoid")
