"""The cards that say in which system, and in which angles, a deck and its answer are stated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.errors import Problem
from musatpy.formats import mapping, system_rows
from musatpy.formats.draft import Draft
from musatpy.formats.statements import statement_problems, system_row
from musatpy.model import CoordinateSystem
from musatpy.units import AngleUnit


def system_roles(draft: Draft) -> Iterator[Problem]:
    """Yield second SYS, SYO and SYF cards of a role, and cards that go with a SYS card that is not there."""
    stated = set(draft.rows["systems"]["systems.role"].tolist())
    for role in system_rows.STATING:
        path = f"{role}.role"
        words = draft.rows[role][path]
        first = {word: int(np.flatnonzero(words == word)[0]) for word in dict.fromkeys(words.tolist())}
        for row, word in enumerate(words.tolist()):
            if not word:
                continue
            card = draft.rows[role].spec(row).mnemonic
            if role != "system_texts" and first[word] != row:
                line = int(draft.rows[role].lines[first[word]])
                yield draft.problem(
                    role, row, f"a second {card} card for {word}; the first is on line {line}", path=path
                )
            elif word not in stated and first[word] == row:
                message = f"no {draft.cards('systems')} card for {word}, which this one goes with"
                yield draft.problem(role, row, message, path=path)


def job_system(draft: Draft) -> Iterator[Problem]:
    """Yield an option of the system that is not that of the SYS card."""
    rows = draft.rows["options"]
    if draft.given_in is None or not len(rows):
        return
    system, kind = str(rows["options.system"][0]), draft.given_in.kind
    also = {kind, CoordinateSystem.LOCAL if kind == CoordinateSystem.LOCAL else CoordinateSystem.GEOGRAPHIC}
    if system and system not in also:
        message = f"a job of system {system}, where the {draft.cards('systems')} card says {kind}"
        yield draft.problem("options", 0, message, path="options.system")


def statements(draft: Draft) -> Iterator[Problem]:
    """Yield what makes no statement: unknown codes, missing grids, other ellipsoids, what a kind lacks."""
    unread = draft.unread("systems", "systems.kind")
    for role, spec in ((system_rows.IN, draft.given_in), (system_rows.OUT, draft.stated_in)):
        if spec is not None and not unread[system_row(draft, role)]:
            yield from statement_problems(draft, role, spec)


def decimal_angles(draft: Draft) -> Iterator[Problem]:
    """Yield the first card of each kind whose angles are in the unit of the SYS card, where that says none."""
    unread = draft.unread("systems", "systems.unit").any()
    if unread or (draft.given_in is not None and draft.given_in.unit is not AngleUnit.DMS):
        return
    for role in ("stations", "attitudes", "control", "wave_origin"):
        rows = draft.rows[role]
        decimal = np.array([mapping.has_stated_unit(spec) for spec in rows.specs], dtype=bool)[rows.kind]
        for row in np.flatnonzero(decimal)[:1].tolist():
            message = f"angles in decimals, and no {draft.cards('systems')} card for IN that says their unit"
            yield draft.problem(role, row, message)


def matrices(draft: Draft) -> Iterator[Problem]:
    """Yield attitudes that are not in the form of the SYS card, and matrices without their three rows."""
    stated = draft.given_in is not None and draft.given_in.angles == system_rows.MATRICES
    rows, links = draft.rows["matrices"], draft.photo["matrices"]
    if draft.unread("systems", "systems.angles").any():
        return
    if len(rows) and not stated:
        message = f"a matrix, and no {draft.cards('systems')} card for IN that says {system_rows.MATRICES}"
        yield draft.problem("matrices", 0, message + _also_angles(draft))
        return
    if stated and _has_angles(draft):
        row, also = _beside_matrices(draft)
        yield draft.problem("attitudes", row, f"angles, where attitudes are stated as matrices{also}")
    numbers = rows["matrices.row"]
    for link in np.unique(links[links >= 0]).tolist():
        of_photo = np.flatnonzero(links == link)
        read = ~draft.unread("matrices", "matrices.row")[of_photo]
        if read.all() and sorted(numbers[of_photo].tolist()) != [1.0, 2.0, 3.0]:
            given = ", ".join(f"{number:g}" for number in numbers[of_photo])
            message = f"the matrix of photo {draft.photo_ids[link]} needs rows 1, 2 and 3, not {given}"
            yield draft.problem("matrices", int(of_photo[0]), message, path="matrices.row")


def _has_angles(draft: Draft) -> bool:
    """Tell whether cards give attitudes as angles; else matrices may stand in their rows."""
    return bool(len(draft.rows["attitudes"])) and draft.rows["attitudes"].specs != draft.rows["matrices"].specs


def _also_angles(draft: Draft) -> str:
    """Return in words where the angles of the photo of the first matrix are; nothing without."""
    link = int(draft.photo["matrices"][0])
    of_photo = np.flatnonzero(draft.photo["attitudes"] == link)
    if link < 0 or not _has_angles(draft) or not of_photo.size:
        return ""
    return f"; the angles of photo {draft.photo_ids[link]} are on line {draft.rows['attitudes'].lines[of_photo[0]]}"


def _beside_matrices(draft: Draft) -> tuple[int, str]:
    """Return the row of the first angles that stand beside a matrix, and in words where that is; else the first."""
    links, matrices = draft.photo["attitudes"], draft.photo["matrices"]
    both = np.flatnonzero((links >= 0) & np.isin(links, matrices))
    if not both.size:
        return 0, ""
    link = int(links[both[0]])
    line = draft.rows["matrices"].lines[np.flatnonzero(matrices == link)[0]]
    more = len(np.unique(links[both])) - 1
    others = f", and {more} more photo{'s have' if more > 1 else ' has'} both" if more else ""
    return int(both[0]), f"; the matrix of photo {draft.photo_ids[link]} is on line {line}{others}"
