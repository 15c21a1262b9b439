"""Blocks with random values in every field, of any coordinate system: they mean nothing, but fit a deck.

What a value may be follows from the field of the cards that holds it, and what a row has from its table.
"""

from dataclasses import fields, replace
from enum import StrEnum
from typing import Any

import numpy as np

from musatpy import model
from musatpy.formats.job_tables import card_family
from musatpy.formats.mapping import factor, slots
from musatpy.formats.refractive_index import index_of
from musatpy.model.block import in_order, parts_of_block
from musatpy.model.tables import Table, columns, types_of
from musatpy.units import ARC_SECOND, DEGREE

_LETTERS = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-+.*/"))
# Of every attribute of the model, its first field on the first card that has it.
_SLOTS = {
    slot.path: slot for spec in reversed(list(card_family().cards.values())) for slot in reversed(slots(spec))
}
_ROWS = {"cameras": (1, 4), "photos": (1, 6), "points": (1, 30), "plates": (1, 40)}  # (0, 5) of the others


def random_block(seed: int, system: model.CoordinateSystem) -> model.Block:
    """Return a block with up to a few rows in every table, values blank here and there, and links everywhere."""
    return _Random(np.random.default_rng(seed), system).block()


class _Random:
    def __init__(self, rng: np.random.Generator, system: model.CoordinateSystem) -> None:
        self.rng = rng
        self.system = system
        self.sizes = {name: int(rng.integers(*_ROWS.get(name, (0, 5)))) for name in parts_of_block()}

    def ids(self, count: int, width: int) -> np.ndarray:
        """Return different texts of one character to `width`."""
        texts: dict[str, None] = {}
        while len(texts) < count:
            texts["".join(self.rng.choice(_LETTERS, self.rng.integers(1, width + 1)))] = None
        return np.array(list(texts), dtype=str)

    def texts(self, path: str, shape: tuple[int, ...], different: bool) -> np.ndarray:
        """Return texts for an attribute, blank here and there where its field may be."""
        field = _SLOTS[path].fields[0]
        if different:
            return self.ids(shape[0], field.edit.width)
        texts = [*(field.allowed or self.ids(3, field.edit.width)), *([""] if field.blank == "missing" else [])]
        return self.rng.choice(texts, shape)

    def sizes_of(self, limit: float, shape: tuple[int, ...]) -> np.ndarray:
        """Return numbers of very different sizes, of either sign, up to `limit`."""
        return limit * self.rng.uniform(-1, 1, shape) * 10.0 ** self.rng.uniform(-6, 0, shape)

    def numbers(self, path: str, shape: tuple[int, ...]) -> np.ndarray:
        """Return numbers for an attribute, some so large that a decimal is dropped; a third NaN where they may be.

        Standard deviations, and what has to be greater than zero, are positive, and not next to nothing.
        """
        slot = _SLOTS[path]
        field, edit = slot.fields[0], slot.fields[-1].edit
        if path.endswith(".position"):
            values = self.positions(shape[0])
        elif slot.is_sexagesimal:
            values = self.angles(2 * np.pi, shape)
        elif edit.letter == "I":
            return self.rng.integers(1, 10**edit.width, shape)
        elif edit.letter == "E":
            return self.rng.normal(0, 1e-3, shape)
        else:
            positive = field.bound is not None or field.is_sigma
            limit = 5.0 * 10.0 ** (edit.width - edit.decimals - (1 if positive else 2)) * factor(slot, DEGREE)
            values = limit * self.rng.uniform(0.01, 1, shape) if positive else self.sizes_of(limit, shape)
        return np.where(self.rng.random(shape) < 1 / 3, np.nan, values) if field.blank == "missing" else values

    def angles(self, limit: float, shape: tuple[int, ...]) -> np.ndarray:
        """Return angles up to `limit`: any, around zero, and just below whole minutes and degrees."""
        angle = self.rng.uniform(-limit, limit, shape)
        near = np.rint(angle / DEGREE * 60) / 60 * DEGREE + self.rng.uniform(-1e-4, 1e-4, shape) * ARC_SECOND
        tiny = self.rng.uniform(-1, 1, shape) * ARC_SECOND
        return np.choose(self.rng.integers(0, 3, shape), [angle, near, tiny])

    def positions(self, count: int) -> np.ndarray:
        if self.system is model.CoordinateSystem.GEOGRAPHIC:
            latitude, longitude = self.angles(np.pi / 2, (count,)), self.angles(np.pi, (count,))
            return np.stack([latitude, longitude, self.sizes_of(3000, (count,))], axis=1)
        return self.sizes_of(9e6, (count, 3))  # beyond 1e7 the fields would drop a decimal

    def table(self, name: str, kind: Any, **given: object) -> Any:
        """Return a table of random rows: some columns as given, the others by their meaning and their field."""
        values = dict(given)
        for column, about in columns(kind).items():
            path, shape = f"{name}.{column}", (self.sizes[name], *about.components)
            if column in given:
                continue
            if about.link:
                values[column] = self.rng.integers(0, self.sizes[about.link], shape)
            elif about.codes:
                values[column] = self.rng.choice(list(about.codes.values()), shape)
            elif types_of(kind)[column] is str:
                values[column] = self.texts(path, shape, different=about.identity or about.key)
            else:
                values[column] = self.numbers(path, shape)
        return kind(**values)

    def single(self, name: str, kind: Any, **given: object) -> Any:
        """Return what one card says, with the default here and there; None where the block has no rows of it."""
        values = dict(given)
        for one in fields(kind):
            path, default = f"{name}.{one.name}", one.default
            if one.name in given:
                continue
            if isinstance(default, StrEnum):
                kinds = list(type(default))
                values[one.name] = kinds[self.rng.integers(len(kinds))]
            elif isinstance(default, bool):
                values[one.name] = bool(self.rng.random() < 0.5)
            elif isinstance(default, str):
                values[one.name] = str(self.texts(path, (1,), different=False)[0])
            else:
                number = self.numbers(path, (1,))[0].item()
                values[one.name] = default if np.isnan(number) else number
        return kind(**values) if self.sizes[name] else None

    def block(self) -> model.Block:
        count, waves = self.sizes["photos"], self.sizes["waves"]
        self.sizes["options"] = 1
        tides = self.rng.random(count) < 0.7
        parts = {
            "options": self.single("options", model.Options, system=self.system),
            "ellipsoid": self.ellipsoid(),
            "water": self.water(),
            "distortion": self.distortion(),
            "points": self.points(self.sizes["points"]),
            "equal_elevations": self.equal_elevations(self.sizes["equal_elevations"]),
            "waves": self.table("waves", model.Waves, height=self.rng.uniform(0, 5, waves)),
            "wave_origin": model.WaveOrigin(position=tuple(self.positions(1)[0].tolist())) if waves else None,
            "orientation": None,
        }
        for name, kind in parts_of_block().items():
            if name not in parts:
                parts[name] = (self.table if issubclass(kind, Table) else self.single)(name, kind)
        known = {name: getattr(parts["photos"], name) for name in ("tide", "tide_sigma", "time")}
        named = {name: getattr(parts["photos"], name) for name in ("tide_group", "tide_day")}
        tide_cards = {name: np.where(tides, values, np.nan) for name, values in known.items()}
        tide_cards |= {name: np.where(tides, values, "") for name, values in named.items()}
        parts["photos"] = replace(parts["photos"], **tide_cards)
        titles = tuple(f"TITLE {number}" for number in range(self.rng.integers(0, 3)))
        return _in_order_of_appearance(model.Block(titles=titles, **parts))

    def ellipsoid(self) -> model.EllipsoidSpec | None:
        if self.system is model.CoordinateSystem.LOCAL:
            return None
        if self.rng.random() < 0.5:
            return model.EllipsoidSpec(name="clrk66")
        return model.EllipsoidSpec(semi_major_axis=6378206.4, inverse_flattening=294.9786982138982)

    def water(self) -> model.Water | None:
        known = model.WaterConditions(temperature=12.5, wavelength=550.0, salinity=35.0)
        given = self.single("water", model.Water, index=1.334, conditions=None)
        computed = model.Water(index=index_of(known), conditions=known, sigma=self.rng.choice([None, 0.002]))
        return self.rng.choice([given, computed])

    def distortion(self) -> model.Distortion:
        values = self.numbers("distortion.values", (self.sizes["distortion"], 3))
        values[self.rng.random(len(values)) < 0.5, 2] = np.nan
        return self.table("distortion", model.Distortion, values=values)

    def points(self, count: int) -> model.Points:
        ids, wet = self.ids(count, 8), self.rng.random(count) < 0.4
        return model.Points(ids=ids, bathymetric=wet, dry=~wet & (np.arange(count) % 4 == 1))

    def equal_elevations(self, groups: int) -> model.EqualElevations:
        members = self.rng.integers(0, 15) if groups else 0
        return model.EqualElevations(
            ids=self.ids(groups, 8),
            sigma=self.rng.uniform(0.01, 1, groups),
            group=np.sort(self.rng.integers(0, max(groups, 1), members)),
            point=self.rng.integers(0, self.sizes["points"], members),
        )


def _in_order_of_appearance(block: model.Block) -> model.Block:
    """Return the block with its points in the order in which a deck names them; a flag needs a plate or control."""
    flagged = np.isin(np.arange(len(block.points.ids)), np.concatenate([block.plates.point, block.control.point]))
    points = replace(block.points, bathymetric=block.points.bathymetric & flagged, dry=block.points.dry & flagged)
    return in_order(replace(block, points=points))
