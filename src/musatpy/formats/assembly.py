"""A draft without errors -> `Block`, and `Block` -> the columns of its cards."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from musatpy import model
from musatpy.arrays import IntArray
from musatpy.formats import job_tables, mapping, system_rows
from musatpy.formats.cards.spec import CardSpec, Family
from musatpy.formats.draft import Draft, first_of_names
from musatpy.formats.statements import in_words
from musatpy.geometry.collinearity import AngleForm, other_angles
from musatpy.model import tables
from musatpy.model.block import parts_of_block
from musatpy.model.tables import columns
from musatpy.units import AngleUnit


def block_of(draft: Draft) -> model.Block:
    """Return the block that a deck describes. The draft must have passed the cross checks."""
    by_photo = {name: about.role for name, about in columns(model.Photos).items() if about.role and not about.link}
    photos = {name: draft.by_photo(role, f"photos.{name}") for name, role in by_photo.items()}
    if draft.given_in is None or draft.given_in.angles == AngleForm.OMEGA_PHI_KAPPA:
        attitude = photos["attitude"]
        beyond = np.cos(attitude[:, 1:2]) < 0.0  # of the two ways to state a rotation, phi within 90 degrees
        photos["attitude"] = np.where(beyond, other_angles(attitude), attitude)
    parts: dict[str, Any] = {
        "options": draft.options,
        "reduction": draft.reduction,
        "water": _water(draft),
        "photos": model.Photos(ids=draft.photo_ids, camera=draft.camera_of_photo, **photos),
        "points": model.Points(ids=draft.point_ids, bathymetric=draft.bathymetric, dry=draft.flagged("points.dry")),
        "equal_elevations": _equal_elevations(draft),
        "waves": waves_of(draft),
    }
    for name, kind in parts_of_block().items():
        if name in parts or (name == "ellipsoid" and draft.system is model.CoordinateSystem.LOCAL):
            continue
        rows = draft.rows[name]
        if not issubclass(kind, tables.Table):
            parts[name] = mapping.single_of(name, rows.values)
            continue
        links = {column: draft.links(about.link)[name] for column, about in columns(kind).items() if about.link}
        values = {column: rows.values.get(f"{name}.{column}") for column in columns(kind) if column not in links}
        parts[name] = kind(**links, **values | _correlations(draft, name))
    titles = tuple(draft.rows["titles"]["titles"].tolist())
    return model.Block(titles=titles, given_in=draft.given_in, stated_in=draft.stated_in, **parts)


def _water(draft: Draft) -> model.Water | None:
    """Return the water of a deck; where it has the conditions of the water, its index is what they give."""
    conditions = mapping.single_of("water_conditions", draft.rows["water_conditions"].values)
    if conditions is None:
        return mapping.single_of("water", draft.rows["water"].values)
    from musatpy.formats.refractive_index import index_of  # most decks give the index itself

    water = mapping.single_of("water", draft.rows["water"].values) or model.Water()
    return replace(water, index=index_of(conditions), conditions=conditions)


def waves_of(draft: Draft) -> model.Waves:
    """Return the waves, with the sigmas that the cards of theirs give; NaN without."""
    ids = draft.rows["waves"]["waves.ids"]
    row, card = np.nonzero(ids[:, None] == draft.rows["wave_sigmas"]["waves.ids"][None, :])
    values = {}
    for name, about in columns(model.Waves).items():
        path = f"waves.{name}"
        values[name] = draft.rows[about.role or "waves"][path]
        if about.role == "wave_sigmas":
            given = values[name]
            values[name] = mapping.blanks(path, given, len(ids))
            values[name][row] = given[card]
    return model.Waves(**values)


def _correlations(draft: Draft, table: str) -> job_tables.Table:
    """Return the column of a table that the cards of covariances say."""
    correlation = np.full((len(draft.rows[table]), 3), np.nan)
    for role in (role for role, of in job_tables.COVARIANCES.items() if of == table):
        row = first_of_names(draft.rows[table], draft.rows[role])
        correlation[row >= 0] = draft.rows[role][f"{table}.correlation"][row[row >= 0]]
        return {"correlation": correlation}
    return {}


def _equal_elevations(draft: Draft) -> model.EqualElevations:
    rows, points = draft.rows["equal_elevations"], draft.point["equal_elevations"]
    ids, group = draft.equal_elevation_groups
    sigma = np.full(len(ids), np.nan)
    given = ~np.isnan(rows["equal_elevations.sigma"])
    sigma[group[given]] = rows["equal_elevations.sigma"][given]
    row, column = np.nonzero(points >= 0)
    return model.EqualElevations(ids=ids, sigma=sigma, group=group[row], point=points[row, column])


def cards_of(block: model.Block, family: Family) -> Iterator[tuple[CardSpec, job_tables.Table]]:
    """Yield the cards of a canonical deck, in their order: the columns of each kind that the block needs.

    Raises `SystemsError` where the block cannot be stated as its deck is to be.
    """
    for spec, values, angle in values_of_cards(block, family):
        yield spec, mapping.scatter(spec, values, angle)


def values_of_cards(block: model.Block, family: Family) -> Iterator[tuple[CardSpec, job_tables.Table, float]]:
    """Yield the same cards with what they say by model attribute, and the radians of their unit of angles."""
    given_in = block.given_in
    block, stating = in_words(block)
    return cards_of_tables(tables_of(block, family) | stating, family, block.options.system, given_in)


def cards_of_tables(
    tables: job_tables.Tables, family: Family, system: str | None, given_in: model.SystemSpec | None = None
) -> Iterator[tuple[CardSpec, job_tables.Table, float]]:
    """Yield the cards of tables, of which any may be missing, with their values and radians.

    Of several cards for one thing they are those of the system, or of how the deck is stated.
    """
    unit = AngleUnit.DMS if given_in is None else given_in.unit
    matrices = given_in is not None and given_in.angles == system_rows.MATRICES
    geographic = (system if given_in is None else given_in.kind) == model.CoordinateSystem.GEOGRAPHIC
    angular = {**dict.fromkeys(job_tables.PLACES, geographic), "attitudes": not matrices}
    role_of = {spec: role for role, specs in job_tables.roles_of(family).items() for spec in specs}
    for spec in family.cards.values():
        role = role_of.get(spec, "")
        if role in angular and mapping.is_angular(spec, job_tables.ROLES[role]) != angular[role]:
            continue
        if angular.get(role) and mapping.has_stated_unit(spec) != (unit is not AngleUnit.DMS):
            continue
        values = tables.get(role, {})
        if role == "water" and "water_conditions" in role_of.values():
            values = _without_computed_index(values, tables.get("water_conditions", {}))
        for covariances, table in job_tables.COVARIANCES.items():
            if role == table and covariances in tables:
                values = _without_sigmas_of(role, values, tables[covariances])
        if job_tables.size(values) or not spec.fields:
            yield spec, values, system_rows.radians_of(unit)


def _without_computed_index(water: job_tables.Table, conditions: job_tables.Table) -> job_tables.Table:
    """Return what the water card says where another one says what its index comes from: nothing, if that is all."""
    if not job_tables.size(conditions):
        return water
    others = [column for path, column in water.items() if path not in ("water.index", "water.liquid")]
    return {**water, "water.index": np.full(1, np.nan)} if any((one == one).any() for one in others) else {}


def _without_sigmas_of(role: str, places: job_tables.Table, covariances: job_tables.Table) -> job_tables.Table:
    """Return what the cards of places say where others have the same sigmas with their correlations."""
    path = f"{role}.sigma"
    sigmas = dict(zip(job_tables.keys_of(role, covariances), covariances[path].tolist(), strict=True))
    rows = zip(job_tables.keys_of(role, places), places[path].tolist(), strict=True)
    same = np.array([sigmas.get(name) == sigma for name, sigma in rows], dtype=bool)
    return {**places, path: np.where(same[:, None], np.nan, places[path])}


def tables_of(block: model.Block, family: Family) -> job_tables.Tables:
    """Return everything that a block says, but for how it is stated: what the cards of a family say of it."""
    roles = (
        (role, specs[0]) for role, specs in job_tables.roles_of(family).items() if role not in system_rows.TABLES
    )
    tables = {role: _table_of(block, role, spec) for role, spec in roles}
    return {role: table for role, table in tables.items() if job_tables.size(table)}


def _table_of(block: model.Block, role: str, spec: CardSpec) -> job_tables.Table:
    """Return what the cards of a role say, by model attribute, one row for each card."""
    table = job_tables.table_of(role)
    if role == "water_conditions":
        return single_values(block.water and block.water.conditions, table)
    part = getattr(block, table)
    match role:
        case "titles":
            return {"titles": np.array(part, dtype=str)}
        case "more_options":
            values, default = (single_values(options, table) for options in (part, model.Options()))
            off = any(values[slot.path] != default[slot.path] for slot in mapping.slots(spec))
            return values if off else {}
        case "equal_elevations":
            return _equal_elevation_values(block, spec)
        case "stations" | "attitudes" | "tides":
            return _table_values(block, table, _photos_with(block.photos, role))
        case _ if role in job_tables.COVARIANCES:
            return _table_values(block, table, np.flatnonzero(part.correlated))
        case "wave_sigmas":
            return _table_values(block, table, np.flatnonzero(block.waves.unknown))
    if isinstance(part, tables.Table):
        return _table_values(block, table, np.arange(part.count))
    return single_values(part, table)


def single_values(part: Any, table: str) -> job_tables.Table:
    """Return what the one card of a part of the model says, by model attribute, one row; nothing of no part."""
    if part is None:
        return {}
    values = {name: getattr(part, name) for name in mapping.names_of(table)}
    return {f"{table}.{name}": np.array([np.nan if value is None else value]) for name, value in values.items()}


def _photos_with(photos: model.Photos, role: str) -> IntArray:
    """Return the photos that have a position, an attitude or a tide, in the order in which a reader meets them.

    Photos take their order from the station cards first, then from the attitude and the tide cards.
    """
    lacks = {
        of: np.isnan(getattr(photos, job_tables.ROLES[of].partition(".")[2]).reshape(photos.count, -1)).any(axis=1)
        for of in ("stations", "attitudes", "tides")
    }
    order = np.argsort(np.argmin(list(lacks.values()), axis=0), kind="stable")
    return order[~lacks[role][order]]


def _table_values(block: model.Block, table: str, rows: IntArray) -> job_tables.Table:
    part = getattr(block, table)
    values: job_tables.Table = {}
    for name, about in columns(type(part)).items():
        value = getattr(part, name)[rows]
        values[f"{table}.{name}"] = getattr(block, about.link).ids[value] if about.link else value
        if about.link == "points":
            values |= {"points.bathymetric": block.points.bathymetric[value], "points.dry": block.points.dry[value]}
    return values


def _equal_elevation_values(block: model.Block, spec: CardSpec) -> job_tables.Table:
    """Return the groups, each on as many cards as its points need, one card for a group without points."""
    groups = block.equal_elevations
    width = sum(slot.path == "equal_elevations.point" for slot in mapping.slots(spec))
    of_cards: list[int] = []
    points: list[list[str]] = []
    for group in range(len(groups.ids)):
        names = block.points.ids[groups.point[groups.group == group]].tolist()
        for first in range(0, len(names) or 1, width):
            of_cards.append(group)
            points.append((names[first : first + width] + [""] * width)[:width])
    return {
        "equal_elevations.ids": groups.ids[of_cards],
        "equal_elevations.sigma": groups.sigma[of_cards],
        "equal_elevations.point": np.array(points, dtype=np.str_).reshape(-1, width),
    }
