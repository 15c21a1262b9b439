"""The draft of a block: what the cards of a deck say, in inside units and with integer links, faults and all.

The cross checks read a draft, because only a deck without errors makes a `Block`. A draft knows the card behind
each value. Its photos, cameras and points are all that any card names, the properly defined ones first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from musatpy import model, units
from musatpy.arrays import BoolArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats import job_tables, mapping, system_rows
from musatpy.formats.cards.deck import CardDeck
from musatpy.formats.cards.spec import CardSpec, Family

AGREES = 0.5001e-3  # of sigmas: half of the last digit of the cards of control


@dataclass(frozen=True, kw_only=True, eq=False)
class Draft:
    """What a deck says. Links are -1 where an identification is blank."""

    deck: CardDeck
    rows: dict[str, job_tables.RoleRows]  # by role
    camera_ids: TextArray
    photo_ids: TextArray
    point_ids: TextArray
    camera: Mapping[str, IntArray] = field(repr=False)  # role -> links to camera_ids, (k,)
    photo: Mapping[str, IntArray] = field(repr=False)  # role -> links to photo_ids, (k,) or (k, 2)
    point: Mapping[str, IntArray] = field(repr=False)  # role -> links to point_ids, (k,) or (k, 5)
    options: model.Options
    reduction: model.ReductionOptions | None  # None: no card
    given_in: model.SystemSpec | None = None  # how the cards state all this; None: as the options say
    stated_in: model.SystemSpec | None = None  # how the answer is to be stated too
    call: Callable[[int], str] | None = None  # what a line stands for where calls make the block; None: a card

    def links(self, table: str) -> Mapping[str, IntArray]:
        """Return the links to cameras, photos or points, by role."""
        return {"cameras": self.camera, "photos": self.photo, "points": self.point}[table]

    @property
    def raw(self) -> bool:
        """True where the plate cards give comparator readings."""
        return self.reduction is not None and self.reduction.plates is model.Plates.RAW

    @property
    def system(self) -> model.CoordinateSystem:
        """The coordinate system of the job: of the cards where it is one of these, else that of the adjustment."""
        return self.options.system

    @property
    def may_lack_station(self) -> bool:
        """True where photos need no station and attitude cards: their initial values are computed, or oriented."""
        return self.options.initial is model.Initial.COMPUTE or self.to_orient

    @property
    def to_orient(self) -> bool:
        """True where a card asks for an orientation through the water."""
        return len(self.rows["orientation"]) > 0

    def cards(self, role: str) -> str:
        """Return the mnemonics of the cards that fill a role: `STA or STX`."""
        specs = self.rows[role].specs
        plain = [spec for spec in specs if self.given_in is not None or not mapping.has_stated_unit(spec)]
        return " or ".join(spec.mnemonic for spec in plain)

    def card(self, role: str) -> str:
        """Return what fills a role, in words: `STA or STX card`, or the call in its place."""
        return self.cards(role) if self.call else f"{self.cards(role)} card"

    def place(self, role: str, row: int) -> str:
        """Return where a row of a role stands, in words: `on line 17`, or `by add_photo('1')`."""
        line = int(self.rows[role].lines[row])
        return f"by {self.call(line)}" if self.call else f"on line {line}"

    @cached_property
    def camera_of_photo(self) -> IntArray:
        """(photos,) link to camera_ids, -1 where no station card names one.

        Where initial values are computed the only camera of the deck took the photos without station card.
        """
        only = self.may_lack_station and np.unique(self.camera["cameras"]).tolist() == [0]
        cameras = np.full(len(self.photo_ids), 0 if only else -1)
        named = np.flatnonzero(self.photo["stations"] >= 0)
        cameras[self.photo["stations"][named]] = self.camera["stations"][named]
        return cameras

    @cached_property
    def equal_elevation_groups(self) -> tuple[TextArray, IntArray]:
        """The equal elevation groups in order of first appearance, and the group of each card."""
        ids, links = _first_appearance([self.rows["equal_elevations"]["equal_elevations.ids"]])
        return ids, links[0]

    @cached_property
    def bathymetric(self) -> BoolArray:
        """(points,) True where any card flags the point as submerged."""
        return self.flagged("points.bathymetric")

    def flagged(self, path: str) -> BoolArray:
        """Return (points,) True where any card has a flag of the point."""
        plates, control = (self.points_of(role, self.rows[role][path]) for role in ("plates", "control"))
        return plates | control

    def points_of(self, role: str, rows: BoolArray) -> BoolArray:
        """Return (points,) True for the points that one of some rows (k,) of a role names."""
        points, links = np.zeros(len(self.point_ids), dtype=bool), self.point[role]
        points[links[rows.astype(bool) & (links >= 0)]] = True
        return points

    def by_photo(self, role: str, path: str) -> NDArray[Any]:
        """Return (photos,) or (photos, components) what the first card of each photo says, blanks without."""
        values = self.rows[role][path]
        result = mapping.blanks(path, values, len(self.photo_ids))
        named = np.flatnonzero(self.photo[role] >= 0)[::-1]  # the first card of a photo is written last
        result[self.photo[role][named]] = values[named]
        return result

    def is_spoilt(self, *roles: str) -> bool:
        """Return whether one of the cards of some roles could not be read, so that what they say is not known."""
        unread = list(self.deck.unread)
        return bool(unread) and any(np.isin(self.rows[role].lines, unread).any() for role in roles)

    @cached_property
    def _unread(self) -> frozenset[tuple[int | None, str | None]]:
        return frozenset((problem.line, problem.field) for problem in self.deck.problems)

    def is_unread(self, line: int, names: Iterable[str]) -> bool:
        """Return whether one of the fields `names` of a card could not be read, which is a problem of the deck."""
        return any((line, name) in self._unread for name in (None, *names))

    def unread(self, role: str, path: str) -> BoolArray:
        """Return (k,) True for the cards of a role on which `path` could not be read."""
        rows = self.rows[role]
        names = {field.name for spec in rows.specs for slot in _slots(spec, path, None) for field in slot.fields}
        lines = [line for line, name in self._unread if name is None or name in names]
        return np.isin(rows.lines, [line for line in lines if line is not None])

    def lacks(self, role: str, row: int, path: str, component: int | None = None) -> bool:
        """Return whether the card of a row has a blank for `path`, and not something that could not be read."""
        rows = self.rows[role]
        names = [field.name for slot in _slots(rows.spec(row), path, component) for field in slot.fields]
        value = rows[path][row] if component is None else rows[path][row, component]
        return bool(value == "" or value != value) and not self.is_unread(int(rows.lines[row]), names)

    def is_angular(self, role: str, path: str) -> BoolArray:
        """Return (k,) True for the cards of a role that give `path` in degrees, minutes and seconds."""
        rows = self.rows[role]
        return np.array([mapping.is_angular(spec, path) for spec in rows.specs], dtype=bool)[rows.kind]

    def names(self, table: str, role: str) -> TextArray:
        """Return what the cards of a role call a camera, photo or point, (k,) or (k, n); empty for a blank."""
        ids = {"cameras": self.camera_ids, "photos": self.photo_ids, "points": self.point_ids}[table]
        return np.append(ids, "")[self.links(table)[role]]

    def problems(
        self, role: str, rows: BoolArray | IntArray, message: str, *columns: NDArray[Any], **place: Any
    ) -> Iterator[Problem]:
        """Yield a problem (see `problem`) of each row of a role that a mask (k,), or its number, names.

        Where there are columns (k,), their values on the row stand in the place of each `{}` of the message.
        """
        for row in np.flatnonzero(rows).tolist() if rows.dtype == bool else rows.tolist():
            text = message.format(*(column[row] for column in columns)) if columns else message
            yield self.problem(role, row, text, **place)

    def problem(
        self,
        role: str,
        row: int,
        message: str,
        *,
        path: str = "",
        component: int | None = None,
        severity: Literal["error", "warning"] = "error",
    ) -> Problem:
        """Return a problem of the card behind a row, at the columns of `path` where one is given."""
        rows = self.rows[role]
        spec, line = rows.spec(row), int(rows.lines[row])
        slots = _slots(spec, path, component)
        columns = (
            (min(slot.columns[0] for slot in slots), max(slot.columns[1] for slot in slots)) if slots else None
        )
        return Problem(
            message=message,
            severity=severity,
            file=self.deck.file,
            line=line,
            columns=columns,
            card=spec.mnemonic,
            field=slots[0].name if len(slots) == 1 else None,
            text=self.deck.images.text(line),
        )


def _slots(spec: CardSpec, path: str, component: int | None) -> list[mapping.Slot]:
    slots = [slot for slot in mapping.slots(spec) if slot.path == path]
    return [slot for slot in slots if component is None or slot.component in (component, None)]


def draft_of(deck: CardDeck, family: Family, flags: job_tables.Flags | None = None) -> Draft:
    """Return the draft of a deck, whatever is wrong with it; its points have `flags` besides those of the cards."""
    roles = job_tables.roles_of(family)
    rows = {role: _rows(role, roles.get(role, ()), deck) for role in system_rows.STATING}
    given_in = system_rows.spec_of(system_rows.IN, rows)
    angle = system_rows.radians_of(given_in.unit if given_in else "")
    rows |= {role: _rows(role, roles.get(role, ()), deck, angle) for role in job_tables.ROLES if role not in rows}
    if len(rows["matrices"]) and not len(rows["attitudes"]):
        rows["attitudes"] = _by_matrices(rows["attitudes"], rows["matrices"])
    if flags:
        rows = {
            role: replace(one, values=job_tables.with_flags(role, one.values, flags)) for role, one in rows.items()
        }
    return draft_of_rows(rows, deck)


def draft_of_rows(
    rows: dict[str, job_tables.RoleRows], deck: CardDeck, call: Callable[[int], str] | None = None
) -> Draft:
    """Return the draft that the rows of every role make; `deck` is where their lines stand, or `call` says what."""
    given_in = system_rows.spec_of(system_rows.IN, rows)
    given = {role: table for role, table in job_tables.COVARIANCES.items() if len(rows[role])}
    rows = rows | {table: _with_covariances(rows[table], rows[role]) for role, table in given.items()}
    options = model.Options(**mapping.said_of("options", rows["options"].values | rows["more_options"].values))
    if given_in is not None:  # the adjustment is geographic where it knows no such system
        known = (
            given_in.kind if given_in.kind in list(model.CoordinateSystem) else model.CoordinateSystem.GEOGRAPHIC
        )
        options = replace(options, system=model.CoordinateSystem(known))
    named: dict[str, Any] = {}
    for table in ("camera", "photo", "point"):
        paths = job_tables.naming(f"{table}s")
        named[f"{table}_ids"], links = _first_appearance([rows[role][path] for role, path in paths.items()])
        named[table] = dict(zip(paths, links, strict=True))
    return Draft(
        deck=deck,
        rows=rows,
        **named,
        options=options,
        reduction=mapping.single_of("reduction", rows["reduction"].values),
        given_in=given_in,
        stated_in=system_rows.spec_of(system_rows.OUT, rows),
        call=call,
    )


def _rows(
    role: str, specs: tuple[CardSpec, ...], deck: CardDeck, angle: float = units.DEGREE
) -> job_tables.RoleRows:
    """Gather the cards of a role, of several mnemonics if there are, in the order of their lines.

    `angle` are the radians of the unit that the deck has for decimal angles.
    """
    if not specs:
        return job_tables.RoleRows.of(role, (), job_tables.nothing(role))
    present = [spec for spec in specs if len(deck.lines[spec.mnemonic])] or specs[:1]
    parts = [mapping.gather(spec, deck.tables[spec.mnemonic], angle) for spec in present]
    kind = np.repeat([specs.index(spec) for spec in present], [len(deck.lines[spec.mnemonic]) for spec in present])
    lines = np.concatenate([deck.lines[spec.mnemonic] for spec in present])
    order = np.argsort(lines, kind="stable")
    of_role = [path for path in parts[0] if path in job_tables.attributes(role)]
    values = {path: np.concatenate([part[path] for part in parts])[order] for path in of_role}
    return job_tables.RoleRows(role=role, specs=specs, kind=kind[order], lines=lines[order], values=values)


def _with_covariances(places: job_tables.RoleRows, covariances: job_tables.RoleRows) -> job_tables.RoleRows:
    """Return the cards of places with the sigmas of those of covariances, where theirs are blank or agree."""
    path = f"{places.role}.sigma"
    given = np.append(covariances[path], np.full((1, 3), np.nan), axis=0)
    given, sigma = given[first_of_names(places, covariances)], places[path]
    taken = (given > 0.0) & ~(np.abs(sigma - given) > AGREES)
    return replace(places, values=places.values | {path: np.where(taken, given, sigma)})


def first_of_names(rows: job_tables.RoleRows, others: job_tables.RoleRows) -> IntArray:
    """Return the first of other cards that name the point, or photo, of each (k,), -1 for none."""
    first = {key: row for row, key in reversed(list(enumerate(job_tables.keys_of(others.role, others.values))))}
    return np.array([first.get(key, -1) for key in job_tables.keys_of(rows.role, rows.values)], dtype=int)


def _first_appearance(columns: list[TextArray]) -> tuple[TextArray, list[IntArray]]:
    """Return the different texts of several columns in the order of first appearance, and links; -1 for blank."""
    texts = [column.ravel().tolist() for column in columns]
    number = {name: row for row, name in enumerate(dict.fromkeys(filter(None, chain(*texts))))}
    unique, row_of = np.array(list(number), dtype=np.str_), (number | {"": -1}).__getitem__
    links = [np.fromiter(map(row_of, names), np.int64, len(names)) for names in texts]
    return unique, [link.reshape(column.shape) for link, column in zip(links, columns, strict=True)]


def _by_matrices(attitudes: job_tables.RoleRows, matrices: job_tables.RoleRows) -> job_tables.RoleRows:
    """Return the cards of the attitudes where matrices stand for them: the first of each photo, the angles open."""
    photos, row = matrices["matrices.photo"], matrices["matrices.row"]
    names, first, which = np.unique(photos, return_index=True, return_inverse=True)
    sigma = np.full((len(names), 3), np.nan)
    of_row = np.flatnonzero((row >= 1) & (row <= 3))
    sigma[which[of_row], row[of_row].astype(int) - 1] = matrices["matrices.sigma"][of_row]
    order = np.argsort(first)
    order = order[names[order] != ""]
    first = first[order]
    values = {path: mapping.blanks(path, column, len(first)) for path, column in attitudes.values.items()}
    return replace(
        attitudes,
        specs=matrices.specs,
        kind=matrices.kind[first],
        lines=matrices.lines[first],
        values=values | {"photos.ids": photos[first], "photos.attitude_sigma": sigma[order]},
    )
