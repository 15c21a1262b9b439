"""The rows of the files of a family <-> parts of a block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import rows_of
from musatpy.errors import CardFormatError, DeckError, Problem
from musatpy.formats import mapping, parts
from musatpy.formats.job_tables import KEYS, Table, Tables, blank, repeated, role_of, size, words_of
from musatpy.formats.records.fields import JOB_UNIT, PACKED, RecordField
from musatpy.formats.records.files import Columns, RecordFile
from musatpy.formats.records.frames import JobFrame
from musatpy.formats.records.layout import OPTION_OF_CAMERAS, OPTION_OF_SYSTEM, FileSpec, RecordSpec

Array = NDArray[Any]
_KIND = "control.kind"
_HYPHEN = "-"
_OFF_ROTATION = 1e-5  # of a product of rows: elements of six decimals are off by a tenth of it
_SIGMAS = {"photos.position_sigma": "photos.position", "control.sigma": "control.position"}
_MARKS = {  # what fiducial marks are called among the plate measurements of a file
    "plates.photo": "fiducial_measurements.photo",
    "plates.point": "fiducial_measurements.ids",
    "plates.xy": "fiducial_measurements.xy",
}


def resolved(file: FileSpec, frame: JobFrame) -> FileSpec:
    """Return a file with the units that the job's system gives it.

    Raises `DeckError` where the file has such units and the system is not known, and where its other units cannot
    be those of the system.
    """
    if frame.system is None:
        if any(field.unit == JOB_UNIT for record in file.records for field in record.fields):
            raise DeckError.of(f"the units of {file.title} are those of the job: {OPTION_OF_SYSTEM}")
        return file
    geographic = frame.geographic and frame.statement is None
    file = _with_units(file, geographic)
    if faults := list(_wrong_units(file, geographic)):
        wrong = f"in a {frame.system} job"
        raise DeckError(Problem(file=file.stated_in, message=f"{fault} {wrong}") for fault in faults)
    return file


def _with_units(file: FileSpec, geographic: bool) -> FileSpec:
    """Return a file with the units of a geographic job or another in place of those of the job."""
    unit = PACKED if geographic and not file.rectangular else "m"

    def of_job(field: RecordField) -> RecordField:
        return replace(field, unit=unit) if field.unit == JOB_UNIT else field

    return replace(file, records=tuple(replace(one, fields=tuple(map(of_job, one.fields))) for one in file.records))


def _wrong_units(file: FileSpec, geographic: bool) -> Iterator[str]:
    """Yield the fields of positions and their sigmas in units that their coordinates cannot have, field by field.

    Coordinates of a file are angles in a geographic job, unless it says that they are rectangular.
    """
    angles = geographic and not file.rectangular
    for leaf in file.leaves():
        for slot in mapping.slots(row_of(file, leaf)):
            if slot.path not in (*_SIGMAS, *_SIGMAS.values()):
                continue
            plane, unit = angles and slot.component in (0, 1), slot.fields[0].unit
            fits = unit in mapping.ANGULAR if plane else unit not in mapping.ANGULAR
            if plane and slot.path in _SIGMAS:
                fits = unit in ("", "m", PACKED)
            if not fits:
                expected = f'`{JOB_UNIT}` or an angle, or coordinates = "rectangular" in the file' if plane else "m"
                yield f"{leaf.name}: {slot.name}: unit: '{unit}', expected {expected}"


def row_of(file: FileSpec, leaf: RecordSpec) -> RecordSpec:
    """Return a kind of row as one record; the parts of a text are one field, named by the first."""
    return replace(leaf, fields=tuple(field for field in file.row_fields(leaf) if field.target and field.part <= 1))


def check_targets(file: FileSpec) -> None:
    """Raise `CardFormatError` for targets that are not in the model, and for units that no job can have."""
    for leaf in file.leaves():
        row = row_of(file, leaf)
        try:
            paths = {slot.path for slot in mapping.slots(row)}
            for path in (*paths, *(path for path, _ in leaf.constants)):
                role = role_of(path, paths)
                if path not in parts.held_attributes(role):
                    raise CardFormatError(f"{leaf.name}: target: '{path}' cannot be held")
            roles = roles_of_row(paths)
            if len(roles) > 1 and {path.partition(".")[0] for path in paths} != {"photos"}:
                raise CardFormatError(f"{leaf.name}: one row cannot say both {' and '.join(roles)}")
        except (CardFormatError, KeyError) as error:
            raise CardFormatError(f"{file.stated_in}: {error}") from error
    faults = min((list(_wrong_units(_with_units(file, kind), kind)) for kind in (True, False)), key=len)
    if faults:
        raise CardFormatError(f"{file.stated_in}: {faults[0]}: no job has coordinates in such units")


def roles_of_row(paths: Iterable[str]) -> list[str]:
    """Return the roles of which a row with these model attributes says more than the identification."""
    paths = sorted(paths)
    attributes = [path for path in paths if not any(path in keys for keys in KEYS.values())]
    return list(dict.fromkeys(role_of(path, paths) for path in attributes or paths))


# --- reading ---


def parts_of_file(file: RecordFile, frame: JobFrame) -> tuple[Tables, list[Problem]]:
    """Return what a file says, and what is wrong between its rows.

    Raises `CardFormatError` where no field of it says by which name a row is known.
    """
    tables_of: dict[str, list[Table]] = {}
    problems: list[Problem] = []
    for leaf in file.spec.leaves():
        lines = file.lines[leaf.name].tolist()
        if not lines:
            continue
        problems += _no_rotations(file, leaf)
        for role, table in _tables(file, leaf, frame).items():
            for path in (key for key in KEYS.get(role, ()) if key not in table):
                message = f"no field has the target {path}, which names the rows of {words_of(role)}"
                raise CardFormatError(f"{file.spec.family}, {file.spec.file}: {message}")
            if not file.spec.fiducials or role != "plates":  # a mark may have the name of a point
                for row in repeated(role, table):
                    known = " ".join(str(table[path][row]) for path in KEYS[role])
                    problems.append(file.problem(lines[row], f"{words_of(role)}: {known} is given twice"))
            tables_of.setdefault(role, []).append(table)
    result = {role: joined(role, tables) for role, tables in tables_of.items()}
    if "control.position" in result.get("control", {}) and frame.joins_control(file.spec):
        problems += _place_control(file, result["control"], frame)
    if file.spec.fiducials and "plates" in result:
        problems += _split_fiducials(file, result)
    return result, problems


def _no_rotations(file: RecordFile, leaf: RecordSpec) -> list[Problem]:
    """Return a problem for each matrix that is no rotation."""
    slots = [slot for slot in mapping.slots(row_of(file.spec, leaf)) if slot.path == "photos.attitude"]
    if len(slots) != 9:
        return []
    elements = [file.tables[leaf.name][slot.fields[0].name] for slot in slots]
    M = np.stack(elements, axis=-1).reshape(-1, 3, 3)
    off = np.abs(M @ np.swapaxes(M, -1, -2) - np.eye(3)).max(axis=(1, 2))
    wrong = (off > _OFF_ROTATION) | (np.linalg.det(M) < 0.0)
    message = "the nine elements are no rotation"
    return [file.problem(line, message) for line in file.lines[leaf.name][wrong].tolist()]


def _tables(file: RecordFile, leaf: RecordSpec, frame: JobFrame) -> Tables:
    """Return the tables of one kind of row, by role."""
    columns = dict(file.tables[leaf.name])
    for head, pieces in _several(file.spec, leaf).items():
        texts = zip(*(columns[piece].tolist() for piece in pieces), strict=True)
        columns[head] = np.array([_HYPHEN.join(text for text in one if text) for one in texts], dtype=str)
    row = row_of(file.spec, leaf)
    values = mapping.gather(row, columns)
    for path, letter in leaf.constants:
        values[path] = np.full(len(file.lines[leaf.name]), mapping.CODES[path][letter])
    _to_model(file.spec, row, values, frame)
    tables: Tables = {role: {} for role in roles_of_row(values)}
    for role, table in tables.items():
        keys = KEYS.get(role, ())
        table.update({p: column for p, column in values.items() if p in keys or role_of(p, values) == role})
    return tables


def _several(spec: FileSpec, leaf: RecordSpec) -> dict[str, list[str]]:
    """Return the fields that are the parts of one text, by the name of the first."""
    pieces: dict[str, list[RecordField]] = {}
    for field in spec.row_fields(leaf):
        if field.part:
            pieces.setdefault(field.target, []).append(field)
    ordered = [sorted(several, key=lambda field: field.part) for several in pieces.values()]
    return {several[0].name: [field.name for field in several] for several in ordered}


def _to_model(spec: FileSpec, row: RecordSpec, values: Table, frame: JobFrame) -> None:
    """Turn positions, sigmas and attitudes of the file into those of the model."""
    packed = {field.target.partition("[")[0] for field in row.fields if field.unit == PACKED}
    for path in ("photos.position", "control.position"):
        if path in values:
            values[path] = _placed(row, path, values[path])
            if path != "control.position" or not frame.joins_control(spec):
                values[path] = frame.position(spec, values[path])
    for path, of in _SIGMAS.items():
        if path in values:
            values[path] = _placed(row, path, values[path])
            if path in packed:  # along longitude, latitude, height: those of east, north, up
                values[path] = values[path] * frame.radii(values[of])
    if "photos.attitude" in values:
        place = values.get("photos.position")
        values["photos.attitude"] = frame.attitude(spec, values["photos.attitude"], place)


def _place_control(file: RecordFile, table: Table, frame: JobFrame) -> list[Problem]:
    """Turn the positions of control points, of which all parts are joined, into those of the job."""
    lacking = np.isnan(table["control.position"]).any(axis=1)
    table["control.position"] = frame.position(file.spec, table["control.position"])
    if frame.has_vertical(file.spec):
        return []
    message = "control point {}: single rectangular coordinates have no meaning in a geographic job"
    return [
        Problem(file=file.file, message=message.format(point)) for point in table["control.point"][lacking].tolist()
    ]


def _placed(row: RecordSpec, path: str, values: Array) -> Array:
    """Return (k, 3) with the components that a row has in their places, NaN in the others."""
    placed = np.full((len(values), 3), np.nan)
    placed[:, [slot.component or 0 for slot in mapping.slots(row) if slot.path == path]] = values
    return placed


def joined(role: str, tables: list[Table]) -> Table:
    """Return the rows of several tables; the horizontal and the vertical part of a control point become one."""
    paths = dict.fromkeys(path for table in tables for path in table)
    table = {
        path: np.concatenate([one.get(path, blank(role, path, size(one))) for one in tables]) for path in paths
    }
    if role == "control" and _KIND in table and repeated(role, table):
        return _joined_control(table)
    return table


def _joined_control(table: Table) -> Table:
    """Return control points whose horizontal and vertical part are one row, in an order that both parts have.

    Where there is such an order files that are written again have it too.
    """
    kinds = mapping.CODES[_KIND]
    columns = {path: column.copy() for path, column in table.items()}
    first: dict[str, int] = {}
    keep: list[int] = []
    place = 0
    for row, (point, kind) in enumerate(zip(table["control.point"].tolist(), table[_KIND].tolist(), strict=True)):
        other = first.get(point)
        if other is not None and {table[_KIND][other], kind} == {kinds["H"], kinds["V"]}:
            for path in {"control.position", "control.sigma"} & columns.keys():
                blank_there = np.isnan(columns[path][other])
                columns[path][other][blank_there] = columns[path][row][blank_there]
            columns[_KIND][other] = kinds["F"]
            place = keep.index(other) + 1
            continue
        if kind != table[_KIND][row - 1]:
            place = 0 if kind == kinds["V"] else len(keep)
        first[point] = row
        keep.insert(place, row)
        place += 1
    return {path: column[keep] for path, column in columns.items()}


def _split_fiducials(file: RecordFile, result: Tables) -> list[Problem]:
    """Move the first measurements of each photo to the fiducial measurements."""
    table, wanted = result["plates"], file.spec.fiducials
    seen: dict[str, int] = {}
    is_mark = np.zeros(size(table), dtype=bool)
    for row, photo in enumerate(table["plates.photo"].tolist()):
        is_mark[row] = seen.setdefault(photo, 0) < wanted
        seen[photo] += 1
    result["fiducial_measurements"] = {mark: table[path][is_mark] for path, mark in _MARKS.items()}
    result["plates"] = {path: column[~is_mark] for path, column in table.items()}
    few = [photo for photo, count in seen.items() if count < wanted]
    count = size(result["plates"])
    readings = f"{count} plate measurements are readings of the comparator, as the fiducial marks are: not refined"
    message = "photo {}: {} measurements; the first {} are its fiducial marks"
    return [Problem(file=file.file, message=message.format(photo, seen[photo], wanted)) for photo in few] or [
        Problem(file=file.file, message=readings, severity="warning")
    ]


# --- writing ---


def rows_of_parts(spec: FileSpec, given: Tables, frame: JobFrame) -> dict[str, Columns]:
    """Return the rows of a file that say the parts, by the name of the record that ends them.

    Raises `DeckError` for parts that the file needs and that are not there.
    """
    if spec.origin_at_principal_point and "plates" in given:
        given = with_origin(given, at_principal_point=True)
    given = _with_fiducials(spec, given) if spec.fiducials else given
    rows: dict[str, Columns] = {}
    for leaf in spec.leaves():
        table = _row_table(spec, leaf, given, frame)
        if not size(table):
            continue
        columns = mapping.scatter(row_of(spec, leaf), table)
        for head, pieces in _several(spec, leaf).items():
            columns |= _split(columns[head], pieces)
        rows[leaf.name] = columns
    return rows


def _split(texts: Array, names: list[str]) -> dict[str, Array]:
    """Return the parts of texts; those before the last are empty where a text has fewer hyphens.

    Raises `DeckError` for texts that begin or end with a hyphen: their parts would not make them again.
    """
    split = [text.rsplit(_HYPHEN, len(names) - 1) for text in texts.tolist()]
    wrong = dict.fromkeys(text for text, pieces in zip(texts.tolist(), split, strict=True) if not all(pieces))
    if wrong:
        raise DeckError(Problem(message=f"'{text}' has no {' and '.join(names)}") for text in wrong)
    filled = [[""] * (len(names) - len(pieces)) + pieces for pieces in split]
    return {name: np.array([pieces[place] for pieces in filled]) for place, name in enumerate(names)}


def paths_of(spec: FileSpec, leaf: RecordSpec) -> set[str]:
    """Return the model attributes that a kind of row says."""
    return {slot.path for slot in mapping.slots(row_of(spec, leaf))} | {path for path, _ in leaf.constants}


def _row_table(spec: FileSpec, leaf: RecordSpec, given: Tables, frame: JobFrame) -> Table:
    """Return the attributes of a kind of row, in the units of the file, for the rows that can be written."""
    paths = paths_of(spec, leaf)
    roles = roles_of_row(paths)
    if any(role not in given for role in roles):
        return {}
    table = _together(roles, given)
    keep = np.ones(size(table), dtype=bool)
    if "plates" in roles and "plates.triangulated" not in paths:
        keep &= table["plates.triangulated"].astype(bool)
    if "control" in roles:
        keep &= can_hold_control(spec, leaf, given["control"], frame)
    table = {path: column[keep] for path, column in table.items()}
    _from_model(spec, row_of(spec, leaf), table, frame)
    return table


def _together(roles: list[str], given: Tables) -> Table:
    """Return the rows that all roles have, by the identification of the first."""
    table = dict(given[roles[0]])
    for role in roles[1:]:
        other = given[role]
        (path,) = KEYS[role]
        rows = rows_of(other[path], table[path])
        table = {name: column[rows >= 0] for name, column in table.items()}
        table |= {name: column[rows[rows >= 0]] for name, column in other.items()}
    return table


def can_hold_control(spec: FileSpec, leaf: RecordSpec, control: Table, frame: JobFrame) -> Array:
    """Return (k,) True for the control points, or their parts, that a kind of row can say."""
    kinds, kind = mapping.CODES[_KIND], control[_KIND]
    constants, paths = dict(leaf.constants), paths_of(spec, leaf)
    if _KIND in constants:
        letter = constants[_KIND]
        fits = kind == kinds[letter]
        if letter in "HV":
            fits |= kind == kinds["F"]
    else:
        codes = next((dict(field.codes).values() for field in spec.row_fields(leaf) if field.target == _KIND), ())
        fits = np.isin(kind, [kinds[letter] for letter in codes or kinds]) if _KIND in paths else kind == kinds["F"]
    if not frame.has_vertical(spec):
        fits &= (kind != kinds["H"]) & (kind != kinds["V"])
    position = frame.file_position(spec, control["control.position"])
    slots = [slot for slot in mapping.slots(row_of(spec, leaf)) if slot.path == "control.position"]
    needed = [slot.component or 0 for slot in slots if slot.fields[0].blank == "error"]
    return np.asarray(fits & ~np.isnan(position[:, needed]).any(axis=1))


def _from_model(spec: FileSpec, row: RecordSpec, table: Table, frame: JobFrame) -> None:
    """Turn positions, sigmas and attitudes of the model into those of the file."""
    packed = {field.target.partition("[")[0] for field in row.fields if field.unit == PACKED}
    for path, of in _SIGMAS.items():
        if path in table and path in packed:
            table[path] = table[path] / frame.radii(table[of])
    if "photos.attitude" in table:
        place = table.get("photos.position")
        table["photos.attitude"] = frame.file_attitude(spec, table["photos.attitude"], place)
    for path in ("photos.position", "control.position"):
        if path in table:
            table[path] = frame.file_position(spec, table[path])


def _with_fiducials(spec: FileSpec, given: Tables) -> Tables:
    """Return parts whose plate measurements begin, photo by photo, with the fiducial measurements.

    Raises `DeckError` with every photo that has another number of them than the file wants.
    """
    plates, marks = given.get("plates", {}), given.get("fiducial_measurements", {})
    marked = _column(marks, "fiducial_measurements.photo")
    photos = list(dict.fromkeys([*marked, *_column(plates, "plates.photo")]))
    message = "photo {} has {} fiducial measurements (FMS); {} wants {}"
    wrong = [
        Problem(message=message.format(photo, marked.count(photo), spec.family, spec.fiducials))
        for photo in photos
        if marked.count(photo) != spec.fiducials
    ]
    if wrong:
        raise DeckError(wrong)
    if not photos:
        return given
    as_plates = {path: marks[mark] for path, mark in _MARKS.items()}
    as_plates["plates.triangulated"] = np.ones(size(marks), dtype=bool)
    table = joined("plates", [as_plates, plates] if plates else [as_plates])
    order = np.argsort([photos.index(photo) for photo in table["plates.photo"].tolist()], kind="stable")
    return given | {"plates": {path: column[order] for path, column in table.items()}}


def with_origin(given: Tables, *, at_principal_point: bool) -> Tables:
    """Return parts with image coordinates about the principal point, or those parts as a deck has them.

    Raises `DeckError` where the camera of a photo, which has the principal point, is not known.
    """
    cameras, stations, plates = given.get("cameras", {}), given.get("stations", {}), given["plates"]
    points = dict(zip(_column(cameras, "cameras.ids"), _column(cameras, "cameras.principal_point"), strict=True))
    camera_of = dict(zip(_column(stations, "photos.ids"), _column(stations, "photos.camera"), strict=True))
    only = next(iter(points)) if len(points) == 1 else ""
    names = [camera_of.get(photo) or only for photo in plates["plates.photo"].tolist()]
    if any(name not in points for name in names):
        message = "image coordinates are about the principal point, and the camera of a photo is not known"
        raise DeckError.of(f"{message}: {OPTION_OF_CAMERAS}")
    shift = np.array([points[name] for name in names])
    xy = plates["plates.xy"] - shift if at_principal_point else plates["plates.xy"] + shift
    return given | {"plates": plates | {"plates.xy": xy}}


def _column(table: Mapping[str, Array], path: str) -> list[Any]:
    return table[path].tolist() if path in table else []


# --- what cannot be held ---


def said_by(file: FileSpec, leaf: RecordSpec) -> dict[str, set[str]]:
    """Return the model attributes that a kind of row says, by role."""
    paths = paths_of(file, leaf)
    roles = {path: role_of(path, paths) for path in paths}
    return {role: {path for path in paths if roles[path] == role} for role in roles.values()}


def held(files: Iterable[FileSpec]) -> dict[str, set[str]]:
    """Return the model attributes that the files of a family hold, by role."""
    by_role: dict[str, set[str]] = {}
    for file in files:
        for leaf in file.leaves():
            for role, paths in said_by(file, leaf).items():
                by_role[role] = by_role.get(role, set()) | paths
        if file.fiducials:
            by_role["fiducial_measurements"] = set(_MARKS.values())
    return by_role
