"""Strips and blocks put together into one job: nothing is lost, and nothing that decks disagree in is guessed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import DeckError, Problem
from musatpy.jobs import agreement
from musatpy.jobs.agreement import Part
from musatpy.jobs.naming import Linking, NamedKind, Once
from musatpy.model import Block, EqualElevations, Photos, PlateMeasurements, Points, WaterLevel, Waves
from musatpy.model.block import in_order, linking, with_tables
from musatpy.model.tables import Table, columns, parts_of, taken
from musatpy.units import MICROMETRE


@dataclass(frozen=True, kw_only=True)
class MergeOptions:
    """What is to be done where decks disagree; decks by their places in the list, -1 for none."""

    join_photos: bool = False  # a photo that several decks have is one photo; else that is an error
    options_from: int = -1  # whose options and water hold
    prefer: int = -1  # whose stations, measurements and control hold


@dataclass(frozen=True, kw_only=True)
class Merged:
    """The merged block, and what was found to be the same."""

    block: Block
    shared: dict[
        NamedKind, tuple[tuple[str, tuple[str, ...]], ...]
    ]  # kind -> names that several decks have, and these
    once: dict[str, int]  # what several decks give alike -> how many of them were dropped
    believed: tuple[str, ...]  # what differs, and holds as the preferred deck says
    notes: tuple[str, ...]


def merged(parts: Sequence[Part], options: MergeOptions | None = None) -> Merged:
    """Return one block of several.

    Equal names are one camera, one point, one group of equal elevations. Raises `DeckError` with everything in
    which the decks contradict one another.
    """
    return _Merger(parts, options or MergeOptions()).merged()


class _Merger:
    """The merging of blocks; problems, notes and what is given twice are gathered as tables are put together."""

    def __init__(self, parts: Sequence[Part], options: MergeOptions) -> None:
        self.parts = tuple(parts)
        self.names = Linking(parts)
        self.options = options
        self.chosen = self.parts[options.options_from] if options.options_from >= 0 else None
        self.head = (self.chosen or self.parts[0]).block  # whose options hold
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self.doubles: dict[str, Once] = {}

    def merged(self) -> Merged:
        self.problems += agreement.same_system(self.parts)
        self.problems += agreement.same_options(self.parts, self.chosen)
        self.problems += agreement.same_reduction(self.parts, self.chosen)
        self.problems += agreement.same_cameras(self.parts)
        water, disagree = agreement.card_of("water", self.parts, self.chosen)
        waves, origin, others = agreement.waves_of(self.parts, self.chosen)
        cards = {name: agreement.card_of(name, self.parts) for name in agreement.in_common()}
        self.problems += [*disagree, *others, *(problem for _, differ in cards.values() for problem in differ)]
        common = {name: card for name, (card, _) in cards.items()}
        block = replace(self._tables(waves), water=water, wave_origin=origin, **common)
        if self.problems:
            raise DeckError(self.problems)
        self._note_water(block)
        return Merged(
            block=in_order(block),
            shared={kind: shared for kind in NamedKind if (shared := self.names.shared(kind))},
            once={what: double.dropped for what, double in self.doubles.items() if double.dropped},
            believed=tuple(name for double in self.doubles.values() for name in double.believed),
            notes=tuple(self.notes),
        )

    def _tables(self, waves: Waves) -> Block:
        """Return the merged tables under the options that hold; what cannot be merged is among the problems."""
        tables: dict[str, Table] = {
            "waves": waves,
            "cameras": taken(self.names.table("cameras"), self._first(NamedKind.CAMERA)),
            **{name: self._of_first_decks(name) for name in linking(self.head, "cameras") if name != "photos"},
            "photos": self._photos(),
            "points": self._points(),
            "plates": self._plates(),
            "equal_elevations": self._groups(),
            "air_bases": self._air_bases(),
            "distances": self._measured("distances", "length", turn=1.0),
            "height_differences": self._measured("height_differences", "difference", turn=-1.0),
        }
        known = {name: self._known_by_keys(name) for name in self.head.tables() if name not in tables}
        titles = tuple(dict.fromkeys(title for part in self.parts for title in part.block.titles))
        return with_tables(replace(self.head, titles=titles), tables | known)

    def _first(self, kind: NamedKind) -> IntArray:
        """Return the row, among those of all parts, in which each name first appears."""
        return np.unique(self.names.all_links(kind), return_index=True)[1]

    def _once(
        self, name: str, label: str, table: Any, key: IntArray, what: Iterable[str], apart: Sequence[str]
    ) -> Any:
        """Return a table of all parts with its rows once; `key` says which are the same, `what` their names."""
        named = [f"{label} {part}" for part in what]
        distinct = self.names.once(name, table, key, named, apart, self.options.prefer)
        self.doubles[label] = distinct
        self.problems += distinct.problems
        return taken(table, distinct.stays)

    def _known_by_keys(self, name: str) -> Any:
        """Return a table whose rows are known by their keys, or by all that they say where they have none."""
        table = self.names.table(name)
        about = columns(type(table))
        keys = [column for column in about if about[column].key] or list(about)
        key = np.column_stack([_ranks(part) for column in keys for part in parts_of(getattr(table, column))])
        names = [self.names.named(about[column].link, getattr(table, column)) for column in keys]
        what = (
            " of ".join([str(last), *(f"{column} {owner}" for column, owner in zip(keys, owners, strict=False))])
            for *owners, last in zip(*names, strict=True)
        )
        return self._once(name, table.row_noun or name.replace("_", " "), table, self._nth(name, key), what, keys)

    def _nth(self, name: str, key: IntArray) -> IntArray:
        """Return keys (k, q + 1) with a number for each reading of a deck: of raw plates there may be several."""
        _, same = np.unique(np.column_stack([key, self.names.deck(name)]), axis=0, return_inverse=True)
        order = np.argsort(same.reshape(-1), kind="stable")
        ranked = same.reshape(-1)[order]
        nth = np.empty(len(key), dtype=int)
        nth[order] = np.arange(len(key)) - np.searchsorted(ranked, ranked)
        return np.column_stack([key, nth])

    # --- cameras and photos ---

    def _of_first_decks(self, name: str) -> Any:
        """Return what belongs to each camera in the first deck that has it."""
        table = self.names.table(name)
        deck = self.names.deck("cameras")[self._first(NamedKind.CAMERA)]
        return taken(table, self.names.deck(name) == deck[table.camera])

    def _photos(self) -> Photos:
        table: Photos = self.names.table("photos")
        shared = self.names.shared(NamedKind.PHOTO)
        if shared and not self.options.join_photos:
            self.problems += [
                Problem(message=f"photo {name} is in several decks: {', '.join(decks)}") for name, decks in shared
            ]
            return taken(table, self._first(NamedKind.PHOTO))
        links = self.names.all_links(NamedKind.PHOTO)
        kept: Photos = self._once("photos", "photo", table, links[:, None], table.ids, ("ids",))
        number = self.names.number[NamedKind.PHOTO]
        return taken(kept, np.argsort([number[name] for name in kept.ids.tolist()]))

    def _air_bases(self) -> Any:
        table, photos = self.names.table("air_bases"), self.names.ids(NamedKind.PHOTO)
        ends = np.sort(table.photo, axis=1)
        what = [f"{photos[a]}-{photos[b]}" for a, b in ends]
        return self._once("air_bases", "air base", table, ends, what, ("photo",))

    # --- points ---

    def _points(self) -> Points:
        ids = self.names.ids(NamedKind.POINT)
        wet: list[list[str]] = [[] for _ in ids]  # names of decks
        dry: list[list[str]] = [[] for _ in ids]
        certain = np.zeros(len(ids), dtype=bool)  # dry by the flag of one deck at least
        for part in self.parts:
            block, links = part.block, self.names.links(part, NamedKind.POINT)
            certain[links[block.points.dry]] = True
            for point in np.unique(np.concatenate([block.plates.point, block.control.point])).tolist():
                (wet if block.points.bathymetric[point] else dry)[links[point]].append(part.name)
        self.problems += [
            Problem(message=f"point {name} is submerged in {', '.join(yes)}, and dry in {', '.join(no)}")
            for name, yes, no in zip(ids, wet, dry, strict=True)
            if yes and no
        ]
        submerged = np.array([bool(decks) for decks in wet], dtype=bool)
        return Points(ids=np.array(ids, dtype=str), bathymetric=submerged, dry=certain & ~submerged)

    def _plates(self) -> PlateMeasurements:
        table: PlateMeasurements = self.names.table("plates")
        if self.names.shared(NamedKind.PHOTO) and not self.options.join_photos:
            return table  # an error already
        table = replace(table, sigma=np.concatenate([self._plate_sigma(part) for part in self.parts]))
        photos, points = self.names.ids(NamedKind.PHOTO), self.names.ids(NamedKind.POINT)
        what = (f"of {points[q]} on {photos[p]}" for p, q in zip(table.photo, table.point, strict=True))
        key = self._nth("plates", np.stack([table.photo, table.point], axis=1))
        kept: PlateMeasurements = self._once("plates", "measurement", table, key, what, ("photo", "point"))
        return kept

    def _plate_sigma(self, part: Part) -> FloatArray:
        """Return the sigmas (m, 2) of a part that mean the same under the options that hold."""
        block, own, now = part.block, part.block.options, self.head.options
        sigma = block.plates.sigma
        if own.plate_sigma != now.plate_sigma and np.isnan(sigma).any():
            sigma = np.where(np.isnan(sigma), own.plate_sigma, sigma)
            micrometres = f"{own.plate_sigma / MICROMETRE:g}"
            self.notes.append(f"{part.name}: its plate sigma of {micrometres} um stands on its plate cards now")
        if own.submerged_factor != now.submerged_factor:
            wet = block.points.bathymetric[block.plates.point][:, None]
            given = np.where(np.isnan(sigma), own.plate_sigma, sigma)
            sigma = np.where(wet, given * (own.submerged_factor / now.submerged_factor), sigma)
            self.notes.append(
                f"{part.name}: its submerged factor of {own.submerged_factor:g} is in its plate sigmas now"
            )
        return sigma

    def _groups(self) -> EqualElevations:
        """Return the groups of all parts: those of one name are one group, and a member of both is one member."""
        number, points = self.names.number[NamedKind.GROUP], self.names.number[NamedKind.POINT]
        given: dict[str, tuple[float, int]] = {}  # sigma, and the part that gave it
        pairs: dict[tuple[int, int], None] = {}
        for place, part in enumerate(self.parts):
            groups, names = part.block.equal_elevations, part.block.points.ids
            for name, sigma in zip(groups.ids.tolist(), groups.sigma.tolist(), strict=True):
                before, owner = given.setdefault(name, (sigma, place))
                if before != sigma and self.options.prefer not in (owner, place):
                    message = f"group {name} has a sigma of {before:g} m in {self.parts[owner].name}, "
                    self.problems.append(Problem(message=f"{message}{sigma:g} m in {part.name}"))
                elif place == self.options.prefer:
                    given[name] = (sigma, place)
            for group, point in zip(groups.group.tolist(), groups.point.tolist(), strict=True):
                pairs[(number[str(groups.ids[group])], points[str(names[point])])] = None
        links = np.array(sorted(pairs, key=lambda pair: pair[0]), dtype=int).reshape(-1, 2)
        sigmas = [given[name][0] for name in number]
        return EqualElevations(
            ids=np.array(list(number), dtype=str), sigma=np.array(sigmas), group=links[:, 0], point=links[:, 1]
        )

    def _measured(self, name: str, attribute: str, turn: float) -> Any:
        """Return what was measured between points, without what another deck gives alike.

        Ends may be given either way round, the value being `turn` times as large then. Other values are other
        measurements, and stay.
        """
        table, points = self.names.table(name), self.names.ids(NamedKind.POINT)
        turned = table.point[:, 0] > table.point[:, 1]
        value = np.where(turned, turn, 1.0) * getattr(table, attribute)
        ends = np.sort(table.point, axis=1)
        key = np.stack([*ends.T, _ranks(value), _ranks(table.sigma)], axis=1)
        what = (f"{points[a]}-{points[b]}" for a, b in ends)
        return self._once(name, name.replace("_", " "), table, key, what, [field.name for field in fields(table)])

    # --- notes ---

    def _note_water(self, block: Block) -> None:
        """Note what the water of the merged job means that the water of its parts did not."""
        level, water = block.options.water_level, block.water
        if level is WaterLevel.ONE:
            self.notes.append("the tides of all decks have one unknown correction in common now")
        kind = {WaterLevel.GROUP: NamedKind.TIDE, WaterLevel.DAY: NamedKind.DAY}.get(level)
        for name, decks in self.names.shared(kind) if kind else ():
            self.notes.append(f"tides of {kind} {name} have one unknown correction: {', '.join(decks)}")
        if water is not None and (water.tilt_east or water.tilt_north):
            self.notes.append("the tilted water turns about the middle of all stations now, where the tides hold")
        for part in self.parts:
            if part.block.water is None and water is not None:
                self.notes.append(f"{part.name} has no water card: the water of the others holds for it")


def _ranks(values: Any) -> IntArray:
    """Return a number (k,) for each value, the same one for the same value."""
    return np.asarray(np.unique(values, return_inverse=True)[1]).reshape(-1)
