"""Values that are well written but cannot be, or are out of the ordinary."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import Problem
from musatpy.formats import mapping
from musatpy.formats.cards.deck import CardTable
from musatpy.formats.cards.spec import FieldSpec
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import ROLES, table_of
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.units import ARC_SECOND, DEGREE

_FOCAL_LENGTHS = (10.0, 3000.0)  # mm: from small formats to reconnaissance cameras
_SOME, _SMALL = 3, 0.01  # images of a camera, and the share of its format in which all of them do not lie
_WITHIN = {">": np.greater, ">=": np.greater_equal}
_LOOSEST_LIMITS = (
    ("options.rotation_limit", 60.0, ARC_SECOND, "seconds of arc"),
    ("options.translation_limit", 1.0, 1.0, "m"),
    ("options.water_limit", 1.0, 1.0, "m"),
)
_COMPONENTS = {
    CoordinateSystem.GEOGRAPHIC: ("latitude", "longitude", "height"),
    CoordinateSystem.GEOCENTRIC: ("X", "Y", "Z"),
    CoordinateSystem.LOCAL: ("X", "Y", "Z"),
}
_LARGEST = {"": 1e9, "m": 1e8, "mm": 1e8, "um": 1e9, "m/s": 1e4}  # by the unit of a field, whatever it means
_SMALLEST_SIGMA = 1e-9  # in any unit: what is as good as that can only be a slip
_FOCAL_LENGTHS_OFF = 5.0  # 79 degrees off the axis: no frame camera has images farther out
_DIRECTIONS = ("east", "north", "up")
_OF_REDUCTION = (
    *("distortion", "fiducials", "fiducial_measurements"),
    *("comparator", "lenses", "mark_distances", "reseau", "cross_measurements"),
)


def options(draft: Draft) -> Iterator[Problem]:
    """Yield limits of the option card that any run can meet. Its plate sigma is one of the sigmas."""
    for path, largest, unit, word in _LOOSEST_LIMITS:
        limit = draft.rows["options"][path] / unit
        message = f"a limit of {{:g}} {word} would call any run converged: {largest:g} {word} at most"
        yield from draft.problems("options", limit > largest * (1.0 + 1e-9), message, limit, path=path)


def bounds(draft: Draft) -> Iterator[Problem]:
    """Yield limits, scales, lengths and numbers that cannot be, as the card formats say."""
    for role, rows in draft.rows.items():
        for kind, spec in enumerate(rows.specs):
            for slot in mapping.slots(spec):
                if slot.fields[0].bound is None:
                    continue
                relation, bound, message = slot.fields[0].bound
                value = rows[slot.path] if slot.component is None else rows[slot.path][:, slot.component]
                beyond = (rows.kind == kind) & ~np.isnan(value) & ~_WITHIN[relation](value, bound)
                yield from draft.problems(role, beyond, message, value, path=slot.path, component=slot.component)


def _components(values: FloatArray) -> FloatArray:
    """Return values (k,) or (k, components), one component after the other: (components, k)."""
    return np.atleast_2d(values.T)


def two_ends(draft: Draft) -> Iterator[Problem]:
    """Yield bases, distances and height differences from a photo, a point or a mark to itself."""
    for role, rows in draft.rows.items():
        for name, message in dict.fromkeys(spec.two_ends for spec in rows.specs if spec.two_ends):
            path = f"{table_of(role)}.{name}"
            first, second = rows[path].T
            yield from draft.problems(role, (first == second) & (first != ""), message, path=path)


def sigmas(draft: Draft) -> Iterator[Problem]:
    """Yield the standard deviations that are zero or negative; a fixed control point may have zeros."""
    message = "a standard deviation must be greater than zero"
    for role, rows in draft.rows.items():
        fixed = rows["control.fixed"] if role == "control" else np.zeros(len(rows), dtype=bool)
        for path in (path for path in rows.values if path.endswith("sigma")):
            for component, value in enumerate(_components(rows[path])):
                bad = (value < 0) | ((value == 0) & ~fixed)
                yield from draft.problems(role, bad, message, path=path, component=component)


def magnitudes(draft: Draft) -> Iterator[Problem]:
    """Yield numbers beyond anything that has their unit, and standard deviations of next to nothing."""
    for table in draft.deck.tables.values():
        for field in (field for field in table.spec.fields if field.edit.is_number):
            value = np.abs(np.asarray(table.columns[field.name], dtype=float))
            largest = _LARGEST.get(field.unit, np.inf)
            small = (value > 0.0) & (value < _SMALLEST_SIGMA) & ("sigma" in field.target)
            for bad, what in (
                (value > largest, f"is beyond {largest:g} {field.unit}".rstrip()),
                (small, f"is next to nothing: {_SMALLEST_SIGMA:g} {field.unit} at least, or a blank"),
            ):
                for row in np.flatnonzero(bad).tolist():
                    yield _field_problem(draft, table, row, field, f"{value[row]:g} {what}")


def sexagesimal(draft: Draft) -> Iterator[Problem]:
    """Yield minutes and seconds outside 0..60, and angles of which only a part is given."""
    for table in draft.deck.tables.values():
        for slot in mapping.slots(table.spec):
            if slot.is_sexagesimal:
                yield from _parts(draft, table, slot)


def _parts(draft: Draft, table: CardTable, slot: mapping.Slot) -> Iterator[Problem]:
    columns = [np.asarray(table.columns[field.name], dtype=float) for field in slot.fields]
    for field, values in zip(slot.fields[1:], columns[1:], strict=True):
        for row in np.flatnonzero((values < 0) | (values >= 60)).tolist():
            what = f"{values[row]:g} is not at least 0 and less than 60"
            yield _field_problem(draft, table, row, field, what)
    missing = np.isnan(columns)
    for row in np.flatnonzero(missing.any(axis=0) & ~missing.all(axis=0)).tolist():
        blanks = [field for field, blank in zip(slot.fields, missing[:, row], strict=True) if blank]
        if not draft.is_unread(int(table.lines[row]), [field.name for field in slot.fields]):
            message = f"blank, but other parts of the {slot.name} are given"
            yield _field_problem(draft, table, row, blanks[0], message)


def _field_problem(draft: Draft, table: CardTable, row: int, field: FieldSpec, message: str) -> Problem:
    line = int(table.lines[row])
    return Problem(
        message=message,
        file=draft.deck.file,
        line=line,
        columns=(field.first, field.last),
        card=table.spec.mnemonic,
        field=field.name,
        text=draft.deck.text(line),
    )


def attitudes(draft: Draft) -> Iterator[Problem]:
    """Yield tilts beyond 90 degrees and headings beyond 360."""
    path = "photos.attitude"
    for component, (limit, name) in enumerate(((90, "tilt"), (90, "tilt"), (360, "heading"))):
        yield from _beyond(draft, "attitudes", path, component, limit, name)


def geographic_positions(draft: Draft) -> Iterator[Problem]:
    """Yield latitudes beyond 90 degrees and longitudes beyond 360."""
    for role in ("stations", "control", "wave_origin"):
        path = ROLES[role]
        for component, (limit, name) in enumerate(((90, "latitude"), (360, "longitude"))):
            yield from _beyond(draft, role, path, component, limit, name)


def _beyond(draft: Draft, role: str, path: str, component: int, limit: float, name: str) -> Iterator[Problem]:
    angle = draft.rows[role][path][:, component] / DEGREE
    # The limit itself is not beyond it, whatever the rounding of its radians.
    beyond = draft.is_angular(role, path) & (np.abs(angle) > limit + 1e-9)
    message = f"a {name} of {{:.4f}} degrees is beyond {limit}"
    yield from draft.problems(role, beyond, message, angle, path=path, component=component)


def cameras(draft: Draft) -> Iterator[Problem]:
    """Yield focal lengths that no aerial camera has."""
    role, path = "cameras", "cameras.focal_length"
    focal = draft.rows[role][path]
    low, high = _FOCAL_LENGTHS
    odd = (focal > 0) & ((focal < low) | (focal > high))
    message = f"a focal length of {{:g}} mm is out of the ordinary ({low:g} to {high:g} mm)"
    yield from draft.problems(role, odd, message, focal, path=path, severity="warning")


def distortion(draft: Draft) -> Iterator[Problem]:
    """Yield calibrated radii without a distortion."""
    rows, path = draft.rows["distortion"], "distortion.values"
    for row in np.flatnonzero(rows["distortion.kind"] == "TABL").tolist():
        if draft.lacks("distortion", row, path, 1):
            message = "a calibrated radius needs its distortion"
            yield draft.problem("distortion", row, message, path=path, component=1)


def ellipsoid(draft: Draft) -> Iterator[Problem]:
    """Yield ellipsoids given in both ways or in neither, unknown names, and axes and flattenings that cannot be."""
    rows = draft.rows["ellipsoid"]
    if not len(rows):
        return
    name, axis, flattening = (
        rows[f"ellipsoid.{key}"][0] for key in ("name", "semi_major_axis", "inverse_flattening")
    )

    def lacks(key: str) -> bool:
        return draft.lacks("ellipsoid", 0, f"ellipsoid.{key}")

    given = [not lacks(key) for key in ("name", "semi_major_axis")]
    names = {key.lower() for key in pyproj.get_ellps_map()}
    for bad, key, message in (
        (all(given), "name", "an ellipsoid has a name or an axis, not both"),
        (not any(given), "name", "an ellipsoid needs a name, or an axis and an inverse flattening"),
        (name and name.lower() not in names, "name", f"'{name}' is no ellipsoid that PROJ knows"),
        (axis <= 0, "semi_major_axis", "an axis must be greater than zero"),
        (
            axis > 0 and lacks("inverse_flattening"),
            "inverse_flattening",
            "blank, where an axis is given; 0 is a sphere",
        ),
        (flattening < 0 or 0 < flattening <= 1, "inverse_flattening", "must be 0, or greater than 1"),
    ):
        if bad:
            yield draft.problem("ellipsoid", 0, message, path=f"ellipsoid.{key}")


def plate_coordinates(draft: Draft) -> Iterator[Problem]:
    """Yield the plate coordinates outside the format of their camera; readings lie anywhere.

    Those outside by more than half the format are errors; without a format, those that no frame camera has.
    """
    if draft.raw:
        return
    cameras, links = draft.rows["cameras"], draft.camera["cameras"]
    size = np.full((len(draft.camera_ids) + 1, 2), np.nan)  # the last row is that of a camera not known
    focal = np.full(len(size), np.nan)
    size[links[links >= 0]] = cameras["cameras.format_size"][links >= 0]
    focal[links[links >= 0]] = cameras["cameras.focal_length"][links >= 0]
    camera = np.append(draft.camera_of_photo, -1)[draft.photo["plates"]]
    xy = np.abs(draft.rows["plates"]["plates.xy"])
    known = size[camera] > 0
    reach = np.where(focal > 0, _FOCAL_LENGTHS_OFF * focal, np.inf)[camera][:, np.newaxis]
    far = xy > np.where(known, size[camera], np.where(np.isnan(size[camera]), reach, np.inf))
    for component, name in enumerate("xy"):
        for row in np.flatnonzero((known & (xy > size[camera] / 2) | far)[:, component]).tolist():
            what = f"{name} = {draft.rows['plates']['plates.xy'][row, component]:g} mm lies"
            owner = f"of camera {draft.camera_ids[camera[row]]}"
            message = f"{what} outside the format of {size[camera[row], component]:g} mm {owner}"
            if not known[row, component]:
                message = f"{what} {_FOCAL_LENGTHS_OFF:g} focal lengths off the axis {owner}, which has no format"
            yield draft.problem(
                "plates",
                row,
                message,
                path="plates.xy",
                component=component,
                severity="error" if far[row, component] else "warning",
            )


def small_plates(draft: Draft) -> Iterator[Problem]:
    """Yield the first image of each camera all of whose images lie near the middle of its format: another unit."""
    if draft.raw:
        return
    cameras, links = draft.rows["cameras"], draft.camera["cameras"]
    camera = np.append(draft.camera_of_photo, -1)[draft.photo["plates"]]
    xy = np.abs(draft.rows["plates"]["plates.xy"])
    for card in np.flatnonzero(links >= 0).tolist():
        rows = np.flatnonzero((camera == links[card]) & np.isfinite(xy).all(axis=1))
        size = cameras["cameras.format_size"][card]
        if len(rows) >= _SOME and (xy[rows] <= _SMALL * size).all() and xy[rows].any():
            message = (
                f"all {len(rows)} images of camera {draft.camera_ids[links[card]]} lie within a hundredth of its "
                "format: are they in millimetres?"
            )
            yield draft.problem("plates", int(rows[0]), message, path="plates.xy", severity="warning")


def control_components(draft: Draft) -> Iterator[Problem]:
    """Yield components that a control card says are known but does not give, or gives without a sigma."""
    rows = draft.rows["control"]
    kinds = rows["control.kind"]
    horizontal = np.isin(kinds, (ControlKind.FULL, ControlKind.HORIZONTAL))
    vertical = np.isin(kinds, (ControlKind.FULL, ControlKind.VERTICAL))
    known = np.stack([horizontal, horizontal, vertical], axis=-1)
    missing = np.isnan(rows["control.position"])
    rectangular = draft.given_in is not None and draft.given_in.kind not in list(CoordinateSystem)
    names = _COMPONENTS[CoordinateSystem.LOCAL if rectangular else draft.system]
    text = [f"the {name} is known by the kind of the point, but blank" for name in names]
    needed = known
    if draft.system is CoordinateSystem.GEOCENTRIC:
        text = [f"X, Y and Z hold a point only together, and {name} is blank" for name in names]
        needed = (known | ~missing).any(axis=1, keepdims=True) & np.ones(3, dtype=bool)
    loose = known & np.isnan(rows["control.sigma"]) & ~rows["control.fixed"][:, np.newaxis]
    unweighted = [f"the {name} component is known and not fixed: it needs a sigma" for name in _DIRECTIONS]
    for path, mask, messages in (
        ("control.position", needed & missing, text),
        ("control.sigma", loose, unweighted),
    ):
        for row, component in np.argwhere(mask).tolist():
            if draft.lacks("control", row, path, component):
                yield draft.problem("control", row, messages[component], path=path, component=component)


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


def plates_taken_as_refined(draft: Draft) -> Iterator[Problem]:
    """Yield once for each kind of card that plate reduction would need: such cards are carried, not applied."""
    if draft.raw:
        return
    for role in _OF_REDUCTION:
        rows = draft.rows[role]
        if len(rows):
            count = "1 card" if len(rows) == 1 else f"{len(rows)} cards"
            message = f"plate coordinates are taken as refined: {count} carried and listed, not applied"
            yield draft.problem(role, 0, message, severity="warning")
