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
from musatpy.jobs.naming import Linking, NamedKind, Once, once
from musatpy.model import Block, EqualElevations, InertialConvention, Photos, PlateMeasurements, Points, WaterLevel
from musatpy.model.block import in_order, linking
from musatpy.model.tables import taken
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
        water, disagree = agreement.water_of(self.parts, self.chosen)
        waves, origin, others = agreement.waves_of(self.parts, self.chosen)
        self.problems += [*disagree, *others]
        block = replace(self._tables(), water=water, waves=waves, wave_origin=origin)
        block = replace(block, inertial_convention=self._inertial_convention())
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

    def _tables(self) -> Block:
        """Return the merged tables under the options that hold; what cannot be merged is among the problems."""
        return replace(
            self.head,
            titles=tuple(dict.fromkeys(title for part in self.parts for title in part.block.titles)),
            cameras=taken(self.names.table("cameras"), self._first(NamedKind.CAMERA)),
            **{name: self._of_first_decks(name) for name in linking(self.head, "cameras") if name != "photos"},
            photos=self._photos(),
            fiducial_measurements=self._on_photos("fiducial_measurements", "fiducial mark"),
            cross_measurements=self._on_photos("cross_measurements", "reseau cross"),
            antenna_positions=self._of_photos("antenna_positions", "antenna position"),
            antenna_covariances=self._of_photos("antenna_covariances", "covariance of the antenna position"),
            exposure_times=self._of_photos("exposure_times", "time"),
            antenna_lines=self._antenna_lines(),
            points=self._points(),
            plates=self._plates(),
            control=self._control(),
            equal_elevations=self._groups(),
            inertial_attitudes=self._of_photos("inertial_attitudes", "inertial attitude"),
            air_bases=self._air_bases(),
            distances=self._measured("distances", "length", turn=1.0),
            height_differences=self._measured("height_differences", "difference", turn=-1.0),
        )

    def _first(self, kind: NamedKind) -> IntArray:
        """Return the row, among those of all parts, in which each name first appears."""
        return np.unique(self.names.all_links(kind), return_index=True)[1]

    def _once(
        self, name: str, label: str, table: Any, key: IntArray, what: Iterable[str], apart: Sequence[str]
    ) -> Any:
        """Return a table of all parts with its rows once; `key` says which are the same, `what` their names."""
        distinct = once(
            table,
            key,
            self.names.deck(name),
            [part.name for part in self.parts],
            what=[f"{label} {part}" for part in what],
            apart=apart,
            prefer=self.options.prefer,
        )
        self.doubles[label] = distinct
        self.problems += distinct.problems
        return taken(table, distinct.stays)

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

    def _on_photos(self, name: str, label: str) -> Any:
        """Return the measured marks, or crosses, of all photos."""
        table, photos = self.names.table(name), self.names.ids(NamedKind.PHOTO)
        what = [f"{mark} of photo {photos[photo]}" for mark, photo in zip(table.ids, table.photo, strict=True)]
        key = self._nth(name, np.stack([table.photo, _ranks(table.ids)], axis=1))
        return self._once(name, label, table, key, what, ("photo", "ids"))

    def _of_photos(self, name: str, label: str) -> Any:
        """Return what a card for each photo says."""
        table, photos = self.names.table(name), self.names.ids(NamedKind.PHOTO)
        what = (photos[photo] for photo in table.photo)
        return self._once(name, label, table, table.photo[:, None], what, ("photo",))

    def _antenna_lines(self) -> Any:
        table = self.names.table("antenna_lines")
        return self._once("antenna_lines", "line", table, _ranks(table.line)[:, None], table.line, ("line",))

    def _air_bases(self) -> Any:
        table, photos = self.names.table("air_bases"), self.names.ids(NamedKind.PHOTO)
        ends = np.sort(table.photo, axis=1)
        what = [f"{photos[a]}-{photos[b]}" for a, b in ends]
        return self._once("air_bases", "air base", table, ends, what, ("photo",))

    def _inertial_convention(self) -> InertialConvention | None:
        given = {one: part.name for part in self.parts if (one := part.block.inertial_convention)}
        if len(given) > 1:
            angles = ", ".join(f"{one.angles} in {name}" for one, name in given.items())
            self.problems.append(Problem(message=f"the angles of inertial attitudes are {angles}"))
        return next(iter(given), None)

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

    def _control(self) -> Any:
        table, points = self.names.table("control"), self.names.ids(NamedKind.POINT)
        what = (points[point] for point in table.point)
        return self._once("control", "control point", table, table.point[:, None], what, ("point",))

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
