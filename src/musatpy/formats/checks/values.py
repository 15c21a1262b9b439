"""Values that are well written but cannot be, or are out of the ordinary."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pyproj

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import Problem
from musatpy.formats import mapping
from musatpy.formats.cards.spec import FieldSpec
from musatpy.formats.checks.check import check
from musatpy.formats.checks.images import FOCAL_LENGTHS, odd_focal_lengths
from musatpy.formats.draft import AGREES, Draft, first_of_names
from musatpy.formats.job_tables import COVARIANCES, KEYS, table_of
from musatpy.formats.system_rows import radians_of
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.model.block import known_of_kinds
from musatpy.model.correlations import LEAST_EIGENVALUE, smallest_eigenvalues
from musatpy.units import DEGREE

_WITHIN = {">": np.greater, ">=": np.greater_equal}
_LARGEST = {"": 1e9, "m": 1e8, "mm": 1e8, "um": 1e9, "m/s": 1e4}  # by the unit of a field, whatever it means
_SMALLEST_SIGMA = 1e-9  # in any unit: what is as good as that can only be a slip
_DOWN = 30.0 * DEGREE  # largest tilts of photos that look down
_ROUNDING = 1e-9  # of limits: they are not beyond themselves, whatever their unit


@check(of_card=True)
def sigmas(draft: Draft) -> Iterator[Problem]:
    """Yield the standard deviations that are zero or negative; a fixed control point may have zeros."""
    message = "a standard deviation must be greater than zero"
    for role, rows in draft.rows.items():
        fixed = rows["control.fixed"] if role == "control" else np.zeros(len(rows), dtype=bool)
        for path in (path for path in rows.values if path.endswith("sigma")):
            for component, value in enumerate(np.atleast_2d(rows[path].T)):
                bad = (value < 0) | ((value == 0) & ~fixed)
                yield from draft.problems(role, bad, message, path=path, component=component)


@check()
def free_and_known(draft: Draft) -> Iterator[Problem]:
    """Yield what is called free, and of which every component has a standard deviation."""
    message = "F says that it is free, and each component has a standard deviation"
    for role, rows in draft.rows.items():
        for path in (path for path in rows.values if path.endswith("free")):
            known = np.isfinite(np.atleast_2d(rows[f"{path.removesuffix('free')}sigma"].T)).all(axis=0)
            yield from draft.problems(role, rows[path] & known, message, path=path)


@check(of_card=True)
def magnitudes(draft: Draft) -> Iterator[Problem]:
    """Yield numbers beyond anything that has their unit, and standard deviations of next to nothing."""
    angle = radians_of(draft.given_in.unit if draft.given_in else "")
    for role, kind, slot, number in _numbers(draft):
        if slot.is_sexagesimal:
            continue
        value, unit = np.abs(number) / mapping.factor(slot, angle), slot.fields[0].unit
        largest = _LARGEST.get(unit, np.inf)
        is_sigma = "sigma" in slot.path and role != "lens_unknowns"  # whose units are powers of mm
        small = (value > 0.0) & (value < _SMALLEST_SIGMA) & is_sigma
        for bad, what in (
            (value > largest, f"is beyond {largest:g} {unit}".rstrip()),
            (small, f"is next to nothing: {_SMALLEST_SIGMA:g} {unit} at least, or a blank"),
        ):
            rows, message = (draft.rows[role].kind == kind) & bad, f"{{:g}} {what}"
            yield from draft.problems(role, rows, message, value, path=slot.path, component=slot.component)


@check(of_card=True)
def sexagesimal(draft: Draft) -> Iterator[Problem]:
    """Yield minutes and seconds outside 0..60, and angles of which only a part is given."""
    for role, kind, slot, _ in _numbers(draft):
        if draft.call or not slot.is_sexagesimal:  # calls give radians
            continue
        rows = draft.rows[role]
        cards, places = draft.deck.tables[rows.specs[kind].mnemonic], np.flatnonzero(rows.kind == kind)
        columns = np.array([cards[field.name] for field in slot.fields], dtype=float)
        for part, card in np.argwhere((columns[1:] < 0) | (columns[1:] >= 60)).tolist():
            what = f"{columns[1 + part, card]:g} is not at least 0 and less than 60"
            yield _of_field(draft.problem(role, places[card], what), slot.fields[1 + part])
        missing = np.isnan(columns)
        for card in np.flatnonzero(missing.any(axis=0) & ~missing.all(axis=0)).tolist():
            if not draft.is_unread(int(rows.lines[places[card]]), [field.name for field in slot.fields]):
                message = f"blank, but other parts of the {slot.name} are given"
                blank = slot.fields[int(missing[:, card].argmax())]
                yield _of_field(draft.problem(role, places[card], message), blank)


def _of_field(problem: Problem, field: FieldSpec) -> Problem:
    return replace(problem, columns=field.columns, field=field.name)


def _numbers(draft: Draft) -> Iterator[tuple[str, int, mapping.Slot, FloatArray]]:
    """Yield every slot of numbers: its role, which card of that has it, and the numbers (k,) of all its cards."""
    for role, rows in draft.rows.items():
        for kind, spec in enumerate(rows.specs):
            for slot in mapping.slots(spec):
                if len(rows) and slot.fields[0].edit.is_number and slot.path in rows.values:
                    values = rows[slot.path]
                    yield role, kind, slot, values if slot.component is None else values[:, slot.component]


@check(of_card=True)
def attitudes(draft: Draft) -> Iterator[Problem]:
    """Yield angles of attitudes beyond a whole turn."""
    role, path = "attitudes", "photos.attitude"
    for component, angle in enumerate(draft.rows[role][path].T / DEGREE):
        message = "an angle of {:.4f} degrees is beyond 360"
        beyond = np.abs(angle) > 360.0 + _ROUNDING
        yield from draft.problems(role, beyond, message, angle, path=path, component=component)


@check(of_card=True, of_job=True)
def tilts(draft: Draft) -> Iterator[Problem]:
    """Yield the photos that look above the horizon by their cards, where most look down."""
    role, path = "attitudes", "photos.attitude"
    attitude = draft.rows[role][path]
    down: BoolArray = np.asarray((np.abs(attitude[:, :2]) < _DOWN).all(axis=1))
    if 2 * np.count_nonzero(down) <= len(down):
        return
    for component, angle in enumerate(attitude.T[:2]):
        up = (np.cos(attitude[:, :2]).prod(axis=1) < 0.0) & (np.cos(angle) < 0.0)
        message = f"a tilt of {{:.4f}} degrees, where most photos have less than {_DOWN / DEGREE:.0f}"
        yield from draft.problems(
            role, up, message, angle / DEGREE, path=path, component=component, severity="warning"
        )


@check(of_card=True)
def cameras(draft: Draft) -> Iterator[Problem]:
    """Yield focal lengths that no aerial camera has."""
    focal, (low, high) = draft.rows["cameras"]["cameras.focal_length"], FOCAL_LENGTHS
    odd = odd_focal_lengths(focal)
    message = f"a focal length of {{:g}} mm is out of the ordinary ({low:g} to {high:g} mm)"
    yield from draft.problems("cameras", odd, message, focal, path="cameras.focal_length", severity="warning")


@check(of_card=True)
def distortion(draft: Draft) -> Iterator[Problem]:
    """Yield calibrated radii without a distortion."""
    role, path = "distortion", "distortion.values"
    for row in np.flatnonzero(draft.rows[role]["distortion.kind"] == "TABL").tolist():
        if draft.lacks(role, row, path, 1):
            yield draft.problem(role, row, "a calibrated radius needs its distortion", path=path, component=1)


@check(of_card=True)
def bounds(draft: Draft) -> Iterator[Problem]:
    """Yield limits, scales, lengths and angles that cannot be, as the card formats say."""
    for role, kind, slot, value in _numbers(draft):
        field, given = slot.fields[0], (draft.rows[role].kind == kind) & ~np.isnan(value)
        if field.bound is not None:
            relation, bound, message = field.bound
            beyond = given & ~_WITHIN[relation](value, bound)
            yield from draft.problems(role, beyond, message, value, path=slot.path, component=slot.component)
        if field.most is not None:
            most, message = field.most
            size = value / mapping.factor(slot, DEGREE)
            beyond = given & (np.abs(size) > most + _ROUNDING)
            yield from draft.problems(role, beyond, message, size, path=slot.path, component=slot.component)


@check(of_card=True)
def two_ends(draft: Draft) -> Iterator[Problem]:
    """Yield bases, distances and height differences from a photo, a point or a mark to itself."""
    for role, rows in draft.rows.items():
        for name, message in dict.fromkeys(spec.two_ends for spec in rows.specs if spec.two_ends):
            path = f"{table_of(role)}.{name}"
            first, second = rows[path].T
            yield from draft.problems(role, (first == second) & (first != ""), message, path=path)


@check(of_card=True, needs="ellipsoid")
def ellipsoid(draft: Draft) -> Iterator[Problem]:
    """Yield ellipsoids given in both ways or in neither, unknown names, and axes and flattenings that cannot be."""
    paths = {key: f"ellipsoid.{key}" for key in ("name", "semi_major_axis", "inverse_flattening")}
    name, axis, flattening = (draft.rows["ellipsoid"][path][0] for path in paths.values())
    lacks = {key: draft.lacks("ellipsoid", 0, path) for key, path in paths.items()}
    given = [not lacks[key] for key in ("name", "semi_major_axis")]
    known = not name or name.lower() in {key.lower() for key in pyproj.get_ellps_map()}
    half = axis > 0 and lacks["inverse_flattening"]
    for bad, key, message in (
        (all(given), "name", "an ellipsoid has a name or an axis, not both"),
        (not any(given), "name", "an ellipsoid needs a name, or an axis and an inverse flattening"),
        (not known, "name", f"'{name}' is no ellipsoid that PROJ knows"),
        (axis <= 0, "semi_major_axis", "an axis must be greater than zero"),
        (half, "inverse_flattening", "blank, where an axis is given; 0 is a sphere"),
        (flattening < 0 or 0 < flattening <= 1, "inverse_flattening", "must be 0, or greater than 1"),
    ):
        if bad:
            yield draft.problem("ellipsoid", 0, message, path=paths[key])


@check()
def control_components(draft: Draft) -> Iterator[Problem]:
    """Yield components that a control card says are known but does not give, or gives without a sigma."""
    rows = draft.rows["control"]
    kinds, missing = rows["control.kind"], np.isnan(rows["control.position"])
    needed = known = known_of_kinds(kinds)
    rectangular = draft.given_in is not None and draft.given_in.kind not in list(CoordinateSystem)
    geographic = draft.system is CoordinateSystem.GEOGRAPHIC and not rectangular
    names = ("latitude", "longitude", "height") if geographic else ("X", "Y", "Z")
    blank = [f"the {name} is known by the kind of the point, but blank" for name in names]
    if draft.system is CoordinateSystem.GEOCENTRIC:
        blank = [f"X, Y and Z hold a point only together, and {name} is blank" for name in names]
        needed = (known | ~missing).any(axis=1, keepdims=True) & np.ones(3, dtype=bool)
    loose = known & np.isnan(rows["control.sigma"]) & ~rows["control.fixed"][:, np.newaxis]
    covariances = draft.rows["control_covariances"]
    loose &= first_of_names(rows, covariances)[:, np.newaxis] < 0  # these have theirs, or a problem
    for row, component in np.argwhere(needed & missing).tolist():
        if draft.lacks("control", row, "control.position", component):
            yield draft.problem("control", row, blank[component], path="control.position", component=component)
    for row in np.flatnonzero(loose.any(axis=1)).tolist():  # all that a card lacks is told as one
        lacking = [
            n for n in np.flatnonzero(loose[row]).tolist() if draft.lacks("control", row, "control.sigma", n)
        ]
        sides, many = ", ".join(("east", "north", "up")[n] for n in lacking), len(lacking) > 1
        words = ("components are", "they need sigmas") if many else ("component is", "it needs a sigma")
        message = f"the {sides} {words[0]} known and not fixed: {words[1]}"
        if lacking:
            one = None if many else lacking[0]
            yield draft.problem("control", row, message, path="control.sigma", component=one)


@check()
def covariances(draft: Draft) -> Iterator[Problem]:
    """Yield covariances of places that cannot be, or that no card takes, or takes with other sigmas."""
    for role, table in COVARIANCES.items():
        if len(draft.rows[role]):
            yield from _covariances(draft, role, table)


def _covariances(draft: Draft, role: str, table: str) -> Iterator[Problem]:
    rows, places, (path,) = draft.rows[role], draft.rows[table], KEYS[role]
    names, sigma, values = rows[path], rows[f"{table}.sigma"], rows[f"{table}.correlation"]
    cards = first_of_names(rows, places)
    of_correlation = f"{table}.correlation"
    for row, component in np.argwhere(np.abs(values) >= 1.0).tolist():
        message = f"a correlation of {values[row, component]:g} is not between -1 and 1"
        yield draft.problem(role, row, message, path=of_correlation, component=component)
    possible = np.asarray((np.abs(values) < 1.0).all(axis=1))
    smallest = smallest_eigenvalues(np.where(possible[:, None], values, 0.0))
    message = "these correlations make no positive definite matrix: its smallest eigenvalue is {:.3g}"
    yield from draft.problems(role, smallest < LEAST_EIGENVALUE, message, smallest, path=of_correlation)
    if draft.to_orient:
        message = "an orientation goes by the standard deviations alone, without their correlations"
        yield draft.problem(role, 0, message, path=of_correlation, severity="warning")
    lost = (cards < 0) & (names != "") & (not draft.is_spoilt(table))
    owner = "control point" if table == "control" else "photo"
    message = f"{owner} {{}} has no {draft.card(table)}: covariances belong to its coordinates"
    yield from draft.problems(role, lost, message, names, path=path)
    for row in np.flatnonzero(cards >= 0).tolist():
        card, name, where = int(cards[row]), names[row], draft.place(table, int(cards[row]))
        given = places[f"{table}.sigma"][card]
        if table == "control" and places["control.fixed"][card]:
            message = f"control point {name} is fixed {where}: covariances have no effect on it"
            yield draft.problem(role, row, message, path=path)
        elif table == "control" and places["control.kind"][card] == ControlKind.VERTICAL:
            message = f"control point {name} has the kind V {where}, and needs its sigma there; expected F, H or C"
            yield draft.problem(role, row, message, path=path)
        elif (np.abs(given - sigma[row])[sigma[row] > 0.0] > AGREES).any():
            here, there = (" ".join(f"{value:g}" for value in values) for values in (sigma[row], given))
            message = f"the sigmas are {here} m here and {there} m {where}: leave those blank"
            yield draft.problem(role, row, message, path=f"{table}.sigma")


@check()
def equal_elevation_groups(draft: Draft) -> Iterator[Problem]:
    """Yield groups without a sigma, with several sigmas, or with fewer than two points."""
    role, path = "equal_elevations", "equal_elevations.sigma"
    sigma = draft.rows[role][path]
    ids, group = draft.equal_elevation_groups
    for link, name in enumerate(ids.tolist()):
        cards = np.flatnonzero(group == link)
        given = cards[~np.isnan(sigma[cards])]
        if all(draft.lacks(role, row, path) for row in cards.tolist()):
            yield draft.problem(role, int(cards[0]), f"group {name} has no sigma", path=path)
        for row in given[sigma[given] != sigma[given[:1]]].tolist():
            message = f"group {name} has a sigma of {sigma[given[0]]:g} m {draft.place(role, given[0])}"
            yield draft.problem(role, row, message, path=path)
        if np.count_nonzero(draft.point[role][cards] >= 0) < 2:
            message = f"group {name} has fewer than two points: it says nothing"
            yield draft.problem(role, int(cards[0]), message, path="equal_elevations.ids", severity="warning")
