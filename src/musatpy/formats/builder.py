"""Blocks made in Python: what is said of cameras, photos, images and control, checked as decks are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from musatpy.errors import DeckError, Problem, in_order, nearest_or_all
from musatpy.formats import assembly, job_tables, mapping, system_rows
from musatpy.formats.cards.deck import CardDeck
from musatpy.formats.checks import cross_check
from musatpy.formats.draft import Draft, draft_of_rows
from musatpy.formats.musat import has_errors
from musatpy.model import Block, CoordinateSystem, EllipsoidSpec, Options, WaterConditions

Texts = str | Sequence[str] | NDArray[np.str_]
Triple = ArrayLike | None

_ANY = "add"  # the call that fills any role
# What people call that fills a role.
_CALLS = {
    "titles": "BlockBuilder",
    "options": "BlockBuilder",
    "more_options": "BlockBuilder",
    "ellipsoid": "BlockBuilder",
    "water": "water",
    "water_conditions": "water",
    "cameras": "add_camera",
    "stations": "add_photo",
    "attitudes": "add_photo",
    "tides": "add_photo",
    "plates": "add_images",
    "control": "add_control",
    "control_covariances": "add_control",
    "equal_elevations": "add_equal_elevations",
    "air_bases": "add_air_base",
    "distances": "add_distance",
    "height_differences": "add_height_difference",
}
_OF_OPTIONS = ("options", "more_options")  # roles of the cards that have them
_OPTIONS = 1  # number of the row of the options, before all that calls add
_NEEDED = {"cameras": "a camera", "plates": "images"}


class BlockBuilder:
    """A block, call by call; `build` checks it as a deck is checked, and says all that is wrong with it at once.

    Positions, attitudes, plate coordinates and sigmas are those of a `Block`: latitude, longitude in radians and
    height in metres in geographic jobs, else metres; radians; plate millimetres. Names may have any length; a deck
    holds 8 characters. A row that one of the calls below does not know is said by `add`.
    """

    def __init__(self, *titles: str, ellipsoid: EllipsoidSpec | str | None = None, **options: Any) -> None:
        """Begin a block with titles, the ellipsoid of a job that is not local, and attributes of `Options`."""
        self._given: list[
            job_tables.RoleRows
        ] = []  # what each call has added; their lines number the rows of all calls
        self._slips: list[Problem] = []
        self._options = self._options_of(options)
        if titles:
            self.add("titles", titles=titles)
        if ellipsoid is not None:
            spec = EllipsoidSpec(name=ellipsoid) if isinstance(ellipsoid, str) else ellipsoid
            self._take("ellipsoid", assembly.single_values(spec, "ellipsoid"))

    def add_camera(
        self,
        camera: str,
        focal_length: float,
        *,
        principal_point: ArrayLike = (0.0, 0.0),
        format_size: ArrayLike | None = None,
    ) -> None:
        """Add a camera: focal length, principal point and format (x, y), mm."""
        values = {"focal_length": focal_length, "principal_point": principal_point, "format_size": format_size}
        self.add("cameras", ids=camera, **values)

    def add_photo(
        self,
        photo: str,
        camera: str = "",
        position: Triple = None,
        attitude: Triple = None,
        *,
        position_sigma: Triple = None,
        attitude_sigma: Triple = None,
        tide: float | None = None,
        tide_sigma: float | None = None,
        tide_group: str = "",
        tide_day: str = "",
        time: float | None = None,
    ) -> None:
        """Add a photo: its camera, exposure station, attitude (X-tilt, Y-tilt, heading), and the water at it.

        Without a camera it is of the only one. Without sigmas position and attitude are starting values; where
        `initial` is COMPUTE they need not be given. `tide` is the height of the water at the exposure, m.
        """
        if position is not None or camera:
            self.add("stations", ids=photo, camera=camera, position=position, position_sigma=position_sigma)
        if attitude is not None:
            self.add("attitudes", ids=photo, attitude=attitude, attitude_sigma=attitude_sigma)
        tides = {
            "tide": tide,
            "tide_sigma": tide_sigma,
            "tide_group": tide_group,
            "tide_day": tide_day,
            "time": time,
        }
        if any(value is not None and value != "" for value in tides.values()):
            self.add("tides", ids=photo, **tides)

    def add_images(
        self,
        photo: Texts,
        points: Texts,
        xy: ArrayLike,
        *,
        sigma: ArrayLike | None = None,
        triangulated: ArrayLike = True,
        submerged: ArrayLike = False,
        dry: ArrayLike = False,
    ) -> None:
        """Add images of points (k,) on a photo, or on photos (k,): plate coordinates (k, 2) mm.

        `sigma` is of all, of x and y, or (k, 2), mm; those not `triangulated` are kept out of the solution. A point
        that is `submerged`, or `dry` for certain, in one call is so.
        """
        flags = {"triangulated": triangulated, "bathymetric": submerged, "dry": dry}
        self.add("plates", photo=photo, point=points, xy=xy, sigma=sigma, **flags)

    def add_control(
        self,
        point: str,
        position: ArrayLike,
        kind: str = "F",
        *,
        sigma: Triple = None,
        correlation: Triple = None,
        fixed: bool = False,
        submerged: bool = False,
        dry: bool = False,
    ) -> None:
        """Add a control point: `F` full, `H` horizontal, `V` vertical, `C` check; sigmas east, north, up, m.

        NaN, or None: not given; a `fixed` point needs no sigmas. Correlations: of east north, east up, north up.
        """
        if correlation is not None:
            self.add("control_covariances", point=point, sigma=sigma, correlation=correlation)
        values = {"kind": kind, "fixed": fixed, "position": position, "sigma": sigma}
        self.add("control", point=point, bathymetric=submerged, dry=dry, **values)

    def water(
        self,
        index: float | None = None,
        *,
        sigma: float | None = None,
        tilt: ArrayLike | None = None,
        tilt_sigma: float | None = None,
        liquid: str | None = None,
        conditions: WaterConditions | None = None,
    ) -> None:
        """Say what the water is: refractive index, or what it comes from; tilt towards east and north, rad.

        An index outside 1.30 to 1.40 needs the name of the liquid.
        """
        if tilt is not None and np.shape(tilt) != (2,):
            self._slip("water", f"tilt: has the shape {np.shape(tilt)}; expected (2,)")
            tilt = None
        east, north = (None, None) if tilt is None else np.asarray(tilt, dtype=float).tolist()
        if conditions is not None:
            self._take("water_conditions", assembly.single_values(conditions, "water_conditions"))
        tilts = {"tilt_east": east, "tilt_north": north, "tilt_sigma": tilt_sigma}
        given = {"index": index, "sigma": sigma, "liquid": liquid} | tilts
        if any(value is not None for value in given.values()) or conditions is None:
            self.add("water", **given)

    def add_equal_elevations(self, group: str, points: Sequence[str], sigma: float) -> None:
        """Add points that lie on one level; `sigma` of each about it, m."""
        self.add("equal_elevations", ids=group, sigma=sigma, point=[list(points)])

    def add_air_base(self, photos: Sequence[str], length: float, sigma: float) -> None:
        """Add the distance between two exposure stations, m."""
        self.add("air_bases", photo=[list(photos)], length=length, sigma=sigma)

    def add_distance(self, points: Sequence[str], length: float, sigma: float) -> None:
        """Add the straight distance between two points, m (IIIA)."""
        self.add("distances", point=[list(points)], length=length, sigma=sigma)

    def add_height_difference(self, points: Sequence[str], difference: float, sigma: float) -> None:
        """Add the height of the second of two points above the first, m (IIIA)."""
        self.add("height_differences", point=[list(points)], difference=difference, sigma=sigma)

    def add(self, role: str, **columns: Any) -> None:
        """Add rows of any kind (`fiducials`, `waves`, `reduction`, ...), by the names that the model has for them.

        Values are of one row, or (k, ...) of k rows; what is left out is blank, as on a card.
        """
        call = _CALLS.get(role, f"add({role!r})")
        if role not in job_tables.ROLES or role in system_rows.TABLES:
            self._slip(call, f"nothing is called so{nearest_or_all(role, job_tables.ROLES)}")
            return
        known = {path.rpartition(".")[2]: path for path in job_tables.nothing(role)}
        values: job_tables.Table = {}
        for name, value in columns.items():
            if name not in known:
                self._slip(call, f"no '{name}' here{nearest_or_all(name, known)}")
            elif value is not None:
                try:
                    values[known[name]] = _column(role, known[name], value)
                except (ValueError, TypeError) as error:
                    self._slip(call, f"{name}: {error}")
                    return
        self._take(role, values)

    def check(self) -> tuple[Problem, ...]:
        """Return every problem, warnings among them, in the order of the calls."""
        return self._checked()[1]

    def build(self) -> Block:
        """Return the block. Raises `DeckError` with every problem where there is an error."""
        draft, problems = self._checked()
        if has_errors(problems):
            raise DeckError(problems)
        return assembly.block_of(draft)

    def _options_of(self, given: dict[str, Any]) -> Options:
        """Return the options; what cannot be is a problem."""
        options, known = Options(), [field.name for field in fields(Options)]
        for name, value in given.items():
            if name not in known:
                self._slip("BlockBuilder", f"no option '{name}'{nearest_or_all(name, known)}")
                continue
            kind = type(getattr(options, name))
            try:
                options = replace(options, **{name: kind(value)})
            except (ValueError, TypeError):
                meant = nearest_or_all(str(value), list(kind)) if issubclass(kind, StrEnum) else ""
                self._slip("BlockBuilder", f"{name}: {value!r} is no {kind.__name__}{meant}")
        return options

    def _slip(self, call: str, message: str) -> None:
        self._slips.append(Problem(card=call, message=message, line=self._next()))

    def _next(self) -> int:
        return int(self._given[-1].lines[-1]) + 1 if self._given else _OPTIONS + 1

    def _take(self, role: str, values: job_tables.Table) -> None:
        """Add rows to a role; those of one value are as many as the others."""
        count = max((len(value) for value in values.values()), default=1)
        if any(len(value) not in (1, count) for value in values.values()):
            sizes = ", ".join(f"{path.rpartition('.')[2]} {len(value)}" for path, value in values.items())
            self._slip(_CALLS.get(role, _ANY), f"not as many rows of each: {sizes}")
            return
        full = {
            path: values[path] if path in values else job_tables.blank(role, path, 1)
            for path in job_tables.nothing(role)
        }
        full = {path: np.repeat(one, count, axis=0) if len(one) < count else one for path, one in full.items()}
        if count:
            self._given.append(job_tables.RoleRows.of(role, (), full, self._next() + np.arange(count)))

    def _checked(self) -> tuple[Draft, tuple[Problem, ...]]:
        draft = self._draft()
        problems = [*self._slips, *(self._placed(problem) for problem in cross_check(draft))]
        for role, what in _NEEDED.items():
            if not len(draft.rows[role]):
                problems.append(Problem(message=f"the block needs {what}: {_CALLS[role]}"))
        return draft, tuple(replace(problem, line=None) for problem in in_order(problems))

    def _draft(self) -> Draft:
        options, first = assembly.single_values(self._options, "options"), np.array([_OPTIONS])
        given = [
            job_tables.RoleRows.of(role, (), {path: options[path] for path in job_tables.nothing(role)}, first)
            for role in _OF_OPTIONS
        ]
        given += self._given
        flags = job_tables.flags_of((part.role, part.values) for part in given)
        rows: dict[str, job_tables.RoleRows] = {}
        for role, specs in job_tables.roles_of(job_tables.card_family()).items():
            of_role = [part for part in given if part.role == role]
            values = {
                path: _stacked([part[path] for part in of_role] or [none])
                for path, none in job_tables.nothing(role).items()
            }
            lines = np.concatenate([first[:0], *(part.lines for part in of_role)])
            if role not in system_rows.TABLES:  # the card that has its units, by the name of the call
                card = job_tables.plain_card(role, self._options.system is CoordinateSystem.GEOGRAPHIC)
                specs = (replace(card, mnemonic=_CALLS.get(role, f"add({role!r})")),)
            rows[role] = job_tables.RoleRows.of(role, specs, job_tables.with_flags(role, values, flags), lines)
        return draft_of_rows(rows, CardDeck.blank("", self._next()), self._label)

    def _placed(self, problem: Problem) -> Problem:
        """Return a problem of a card as one of the call that has added it."""
        card = None if problem.card is None else self._label(problem.line) if problem.line else problem.card
        return replace(problem, card=card, file=None, columns=None, text=None)

    def _label(self, line: int) -> str:
        """Return the call that has added a row, with what that is about."""
        rows = next((part for part in reversed(self._given) if part.lines[0] <= line <= part.lines[-1]), None)
        if rows is None:
            return _CALLS["options"]
        about = job_tables.attributes(rows.role).items()
        links = [path for path, attribute in about if attribute.link]
        ids = [path for path, attribute in about if attribute.identity or attribute.key] or links[:1]
        names = [str(name) for path in ids for name in np.ravel(rows[path][line - rows.lines[0]])]
        call = _CALLS.get(rows.role, _ANY)
        names = [rows.role, *names] if call == _ANY else names
        return f"{call}({', '.join(map(repr, filter(None, dict.fromkeys(names))))})"


def _stacked(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return the rows of all parts; of lists of names, the shorter ones end in blanks."""
    if parts[0].ndim == 2 and parts[0].dtype.kind == "U":
        width = max(part.shape[1] for part in parts)
        parts = [np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values="") for part in parts]
    return np.concatenate(parts)


def _column(role: str, path: str, value: Any) -> NDArray[Any]:
    """Return values of an attribute (k, ...): of one row, or of k. Raises `ValueError` for another shape."""
    codes = mapping.CODES.get(path)
    like = job_tables.blank(role, path, 0)
    if codes is not None and not isinstance(value, bool | np.ndarray):
        values: list[Any] = [
            codes.get(str(one), one) for one in ([value] if isinstance(value, str | int) else value)
        ]
        for one in values:
            if one not in codes.values():
                raise ValueError(f"{one!r} is not one of {', '.join(filter(None, codes))}")
        return np.array(values)
    array = np.asarray(value, dtype=np.str_ if like.dtype.kind == "U" else like.dtype)
    components = like.shape[1:]
    if path == "equal_elevations.point":
        return np.atleast_2d(array)
    if components and array.ndim == 0:
        array = np.broadcast_to(array, components)
    array = array if array.ndim > len(components) else array[np.newaxis]
    if array.shape[1:] != components:
        expected = " and ".join(str(shape) for shape in (components, ("k", *components)) if shape)
        raise ValueError(f"has the shape {np.shape(value)}; expected {expected.replace(chr(39), '')}")
    return array
