"""Decks that state coordinates and attitudes in other words than the adjustment: cards -> job, and job -> cards.

The room `systems` knows how; it is loaded only for decks that have such a card.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import Problem, SystemsError
from musatpy.formats import mapping, system_rows
from musatpy.formats.job_tables import COVARIANCES, PLACES, ROLES, Tables, words_of
from musatpy.model import Block, CoordinateSystem, EllipsoidSpec, Photos, SystemSpec
from musatpy.model.block import with_tables
from musatpy.model.tables import columns
from musatpy.units import ARC_SECOND

if TYPE_CHECKING:
    from musatpy.formats.draft import Draft

OF_SYSTEM = "SYST"  # sigmas are those of the coordinates and attitudes as stated
_ROUNDING = 1e-14  # rad: an angle of zero comes back from a rotation with a sign, which cards would show


def in_words(block: Block) -> tuple[Block, Tables]:
    """Return a job as its deck states it, and what the cards of the statement and of matrices say, by table.

    Raises `SystemsError` where the job cannot be stated so.
    """
    specs = {system_rows.IN: block.given_in, system_rows.OUT: block.stated_in}
    if not any(specs.values()):
        return block, {}
    cards = system_rows.values_of(specs)
    if block.given_in is None:
        return block, cards
    from musatpy.systems import stated, statement_of

    out = stated(block, statement_of(block.given_in, block))
    attitude = out.block.photos.attitude
    attitude = np.where(np.abs(attitude) < _ROUNDING, 0.0, attitude)
    job = replace(out.block, photos=replace(out.block.photos, attitude=attitude))
    job = _with_sigmas(job, block.given_in, lambda sigma, unit: sigma / unit)
    if job.options.system is CoordinateSystem.GEOCENTRIC:  # the adjustment's is written: it is the same one
        job = replace(job, options=replace(job.options, system=CoordinateSystem.GEOGRAPHIC))
    if out.matrices is not None:  # three cards for each photo that has one, in the order of a reader
        known = np.flatnonzero(np.isfinite(out.matrices).all(axis=(1, 2)))
        known = known[np.argsort(np.isnan(job.photos.position[known]).any(axis=1), kind="stable")]
        cards["matrices"] = {
            "matrices.photo": np.repeat(job.photos.ids[known], 3),
            "matrices.row": np.tile([1.0, 2.0, 3.0], len(known)),
            "matrices.elements": out.matrices[known].reshape(-1, 3),
            "matrices.sigma": job.photos.attitude_sigma[known].ravel(),
        }
    return job, cards


def entered_draft(draft: Draft, block: Block) -> tuple[Draft, Block, tuple[Problem, ...]]:
    """Return a draft and its block as the adjustment knows them, and every problem of taking them in.

    With errors they stay as they were.

    `block` is that of the draft, which must have passed the checks that need no coordinates.
    """
    from musatpy.formats.draft import first_of_names
    from musatpy.systems import Stated, entered, statement_of

    assert draft.given_in is not None
    block = _with_sigmas(block, draft.given_in, lambda sigma, unit: sigma * unit)
    matrices, rows = None, draft.rows["matrices"]
    if len(rows):  # NaN where none is given
        matrices = np.full((len(draft.photo_ids), 3, 3), np.nan)
        matrices[draft.photo["matrices"], rows["matrices.row"].astype(int) - 1] = rows["matrices.elements"]
    given = Stated(block=block, matrices=matrices)
    statement = statement_of(draft.given_in, block)
    try:
        job, warnings = entered(given, statement)
    except SystemsError as error:
        places = _unreached(draft, statement.system.level)
        return draft, block, places or tuple(_placed(draft, problem) for problem in error.problems)
    problems = tuple(_placed(draft, problem) for problem in warnings)
    new: Tables = {role: {} for role in ("stations", "attitudes", "tides")}
    for column, about in columns(Photos).items():
        if about.role and not about.link:
            new[about.role][f"photos.{column}"] = getattr(job.photos, column)[draft.photo[about.role]]
    for name, given_table in block.tables().items():
        if (table := getattr(job, name)) is not given_table and name in draft.rows:
            names = [column for column, about in columns(type(table)).items() if not about.link]
            cards = {f"{name}.{column}": getattr(table, column) for column in names}
            new[name] = {path: cards[path] for path in draft.rows[name].values if path in cards}
    for covariances, name in COVARIANCES.items():
        table = getattr(job, name)
        row = first_of_names(draft.rows[covariances], draft.rows[name])
        restated = np.append(np.hstack([table.sigma, table.correlation]), np.full((1, 6), np.nan), axis=0)[row]
        new[covariances] = {f"{name}.sigma": restated[:, :3], f"{name}.correlation": restated[:, 3:]}
    if job.wave_origin is not None:
        new["wave_origin"] = {"wave_origin.position": np.array([job.wave_origin.position])}
    changed = {role: replace(draft.rows[role], values=draft.rows[role].values | new[role]) for role in new}
    job = replace(job, given_in=draft.given_in, stated_in=draft.stated_in)
    return replace(draft, rows=draft.rows | changed, options=job.options), job, problems


def answer_problems(draft: Draft, block: Block) -> tuple[Problem, ...]:
    """Return what keeps the answer from its system: stations and control points that this does not reach, or axes.

    A warning says how many of them lie outside the area for which the system is meant.
    """
    from musatpy.systems import own_statement, statement_of

    assert draft.stated_in is not None
    job_system, statement = own_statement(block).system, statement_of(draft.stated_in, block)

    def reach(places: FloatArray) -> None:
        level = job_system.level(places)
        statement.system.jacobian(level)
        statement.system.coordinates(level)
        statement.reference(level)

    unreached = _unreached(draft, reach)
    axes = [problem for problem in unreached if problem.field == "axes"]
    if unreached:
        return (_of_statement(draft, system_rows.OUT, axes[0]),) if axes else unreached
    places = np.concatenate([block.photos.position, block.control.position])
    level = job_system.level(places[np.isfinite(places).all(axis=1)])
    number = int(np.count_nonzero(statement.system.outside(level)))
    area = f"outside the area of {statement.system.text}"
    message = f"{number} of the {len(level)} stations and control points lie {area}"
    outside = Problem(message=message, field="definition", severity="warning")
    return (_of_statement(draft, system_rows.OUT, outside),) if number else ()


def _with_sigmas(block: Block, spec: SystemSpec, scaled: Callable[[FloatArray, FloatArray], FloatArray]) -> Block:
    """Return a block with sigmas of coordinates scaled by their unit on cards: that of latitudes is no metre."""
    if spec.sigmas != OF_SYSTEM or spec.kind != CoordinateSystem.GEOGRAPHIC:
        return block
    unit = np.array([1e-3 * ARC_SECOND, 1e-3 * ARC_SECOND, 1.0])  # 1 m would be .03 arc seconds
    photos = replace(block.photos, position_sigma=scaled(block.photos.position_sigma, unit))
    every: dict[str, Any] = {name: getattr(block, name) for name in COVARIANCES.values()}
    tables = {name: replace(table, sigma=scaled(table.sigma, unit)) for name, table in every.items()}
    return with_tables(block, tables | {"photos": photos})


def _unreached(draft: Draft, reach: Callable[[FloatArray], object]) -> tuple[Problem, ...]:
    """Return stations, control and origin of waves at which `reach` raises `SystemsError`, each at its card."""
    problems = []
    of_cards = {role: draft.rows[role][ROLES[role]] for role in PLACES}
    every = np.concatenate(list(of_cards.values()))
    try:
        reach(every[np.isfinite(every).all(axis=1)])
        return ()
    except SystemsError:
        pass  # now one by one
    for role, places in of_cards.items():
        for row in np.flatnonzero(np.isfinite(places).all(axis=1)).tolist():
            try:
                reach(places[row : row + 1])
            except SystemsError as error:
                problem = error.problems[0]
                if problem.field == "axes":  # of the system, wherever the place
                    return (problem,)
                problems.append(draft.problem(role, row, problem.message, path=ROLES[role]))
    return tuple(problems)


def _placed(draft: Draft, problem: Problem) -> Problem:
    """Return a problem of the statement at the card of the photo or point that it is of, else at the SYS card."""
    of_photo, message = draft.photo_ids == problem.found, problem.message
    of_photos = [name for name in COVARIANCES.values() if name in draft.photo]
    for kind, role, path, rows, words in (
        ("photo", "attitudes", "photos.attitude", draft.photo, ("attitude", "matrix", "turn about")),
        *(("photo", name, f"{name}.sigma", draft.photo, (words_of(name),)) for name in of_photos),
        ("photo", "stations", "photos.position", draft.photo, ("",)),
        ("photo", "tides", "photos.tide", draft.photo, ("tide",)),
        ("control point", "control", "control.position", draft.point, ("",)),
    ):
        if problem.found is None or not message.startswith(f"{kind} {problem.found}:"):
            continue
        named = of_photo if kind == "photo" else draft.point_ids == problem.found
        cards = np.flatnonzero(np.append(named, False)[rows[role]])
        if cards.size and any(word in message for word in words):
            return draft.problem(role, int(cards[0]), message, path=path, severity=problem.severity)
    return _of_statement(draft, system_rows.IN, problem)


def system_row(draft: Draft, role: str) -> int:
    """Return the row of the SYS card of a role, which must be there."""
    return int(np.flatnonzero(draft.rows["systems"]["systems.role"] == role)[0])


def statement_problems(draft: Draft, role: str, spec: SystemSpec) -> tuple[Problem, ...]:
    """Return why the SYS card of a role makes no statement, at the card that says so."""
    from musatpy.systems import statement_on

    local = draft.system is CoordinateSystem.LOCAL
    ellipsoid = None if local else _ellipsoid(draft)
    if not local and ellipsoid is None:
        return ()  # said of the ellipsoid card
    if local != (spec.kind == CoordinateSystem.LOCAL):
        what = "a local job stands nowhere on the ellipsoid" if local else "the job is on the ellipsoid"
        message = f"{what}, and cannot be stated in a system of kind {spec.kind}"
        return (draft.problem("systems", system_row(draft, role), message, path="systems.kind"),)
    try:
        statement_on(spec, ellipsoid)
    except SystemsError as error:
        return tuple(_of_statement(draft, role, problem) for problem in error.problems)
    return ()


def _ellipsoid(draft: Draft) -> EllipsoidSpec | None:
    """Return the ellipsoid of a draft, None where its card makes none."""
    try:
        spec: EllipsoidSpec | None = mapping.single_of("ellipsoid", draft.rows["ellipsoid"].values)
    except ValueError:  # a name and an axis, or neither
        return None
    half = spec is not None and (spec.semi_major_axis is None) != (spec.inverse_flattening is None)
    return None if half else spec


def _of_statement(draft: Draft, role: str, problem: Problem) -> Problem:
    """Return a problem of the statement of a role at the card that has the field it is of."""
    row, name = system_row(draft, role), problem.field
    message = f"{name}: {problem.message}" if name in ("origin", "false") else problem.message
    if name in ("definition", "geoid"):
        texts = draft.rows["system_texts"]
        kind = system_rows.DEFINITION if name == "definition" else system_rows.GEOID
        of_role = (texts["system_texts.role"] == role) & (texts["system_texts.kind"] == kind)
        short = name == "definition" and draft.rows["systems"]["systems.definition"][row] != ""
        if of_role.any() and not short:
            line = int(np.flatnonzero(of_role)[0])
            return draft.problem("system_texts", line, message, path="system_texts.text", severity=problem.severity)
    path = f"systems.{name}" if name in ("axes", "definition") else ""
    return draft.problem("systems", row, message, path=path, severity=problem.severity)
