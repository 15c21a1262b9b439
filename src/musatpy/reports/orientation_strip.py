"""A strip oriented through the water (`musat orient`, method STRIP), and the study of an orientation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.reports.editing import number_text
from musatpy.reports.fields import Document, Field, FieldGroup, Node, Rows, identity
from musatpy.reports.orientation import (
    JOB,
    LEFT_OUT,
    LEFT_OUT_TABLE,
    PLANE,
    POINT_TABLE,
    POINTS,
    STATIONS,
    VERDICT,
    first_sections,
    sigma0_text,
)
from musatpy.reports.pages import Section, text_of
from musatpy.reports.table import Report, filled, sheet
from musatpy.units import DEGREE

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.orientation.twomedia.study import LevelPrecision, OrientationStudy
    from musatpy.orienting.strip_answer import StripAnswer

_ABOUT = (
    "A strip oriented through a plane of water by triplets that are joined (Okamoto and Mori 1974) and adjusted by "
    "IIIA, in metres and radians; sigmas are a posteriori, null where IIIA does not hold the strip: all values are "
    "those of the joined triplets then. Axes are those of the job, or of a model near those of the first triplet"
)
_NOTE = (
    "Z = level + tilt . (X, Y) in the axes of the strip, the level over the middle of the points of three photos, "
    "as the triplets are joined: first values, from which IIIA starts."
)

FIT: FieldGroup[StripAnswer, StripAnswer] = FieldGroup(
    "fit", "how the images fit in IIIA, in all triplets where it has no solution", (
        Field("sigma0", "number", "standard deviation of unit weight"),
        Field("redundancy", "integer", "observations less unknowns"),
        Field("fits", "boolean", "sigma0 passes its test of 99.9 %"),
        Field("adjusted", "boolean", "IIIA holds the strip", lambda a: a.solution is not None),
        Field("unadjusted", "string", "why it does not, empty where it does"),
    ),
)  # fmt: skip
STRIP_PLANE: FieldGroup[Any, Any] = FieldGroup(
    "plane",
    "the plane of water Z = level + slope . (X, Y), about the middle of the axes; sigmas null without IIIA",
    tuple(field for field in PLANE.fields if not field.name.startswith("paper")),
)
TRIPLETS: Rows[StripAnswer, StripAnswer] = Rows(
    "triplets", "three photos on end each", (
        Field("photo", "string", "the first of them", lambda a: a.photos[:-2], "First\nphoto", "A8", is_id=True),
        Field("points", "integer", "that took part", lambda a: [len(m.points) for m in a.strip.triplets], "Points",
              "I6"),
        Field("redundancy", "integer", "", lambda a: [m.oriented.redundancy for m in a.strip.triplets], "Redund.",
              "I7"),
        Field("sigma0", "number", "", lambda a: np.array([m.oriented.sigma0 for m in a.strip.triplets]), "Sigma0",
              "F8.4"),
        Field("slope", "2 number", "of the water", lambda a: a.planes[:, :2],
              ("Tilt X\narc sec", "Tilt Y\narc sec"), "F12.2"),
        Field("level", "number", "of the water, over the middle of the points", "levels", "Level\nm", "F14.4"),
        Field("share", "number?", "sigma of the level, of the mean depth; null without limit",
              lambda a: np.array([m.oriented.level_share() for m in a.strip.triplets]), "Of depth", "F8.4"),
        Field("paper", "3 number", "a, b and d of the paper", lambda a: a.planes * [1.0, -1.0, 1.0]),
    ),
)  # fmt: skip
JOINS: Rows[StripAnswer, StripAnswer] = Rows(
    "joins", "of a triplet to the one before it", (
        Field("photo", "string", "first photo of the triplet before", lambda a: a.photos[:-3], "From\nphoto", "A8",
              is_id=True),
        Field("last", "string", "last photo of that after", lambda a: a.photos[3:], "To\nphoto", "A8", is_id=True),
        Field("points", "integer", "common ones", lambda a: [len(join.points) for join in a.strip.joins], "Points",
              "I6"),
        Field("left_out", "integer", "of these", lambda a: [int(join.left_out.sum()) for join in a.strip.joins],
              "Out", "I4"),
        Field("scale", "number", "of the similarity",
              lambda a: np.array([join.move.scale for join in a.strip.joins]), "Scale", "F10.6"),
        Field("turn", "number", "of the similarity", "join_turn", "Turn\ndegrees", "F10.5"),
        Field("residual", "number", "root mean square, of a coordinate", "join_residual", "RMS\nm", "F10.5"),
        Field("station", "number", "root mean square of both stations, of a coordinate", "join_station",
              "Stations\nm", "F10.5"),
        Field("slope", "2 number", "of the water before less after", lambda a: a.join_plane[:, :2],
              ("Water X\narc sec", "Water Y\narc sec"), "F12.2"),
        Field("level", "number", "of the water before less after", lambda a: a.join_plane[:, 2], "Level\nm",
              "F12.4"),
    ),
)  # fmt: skip
CONTROL: Rows[StripAnswer, StripAnswer] = Rows(
    "control", "what holds the strip on the ground", (
        identity("point", "control_ids"),
        Field("residual", "3 number?", "known less oriented", "control_residual",
              ("Residual X\nm", "Residual Y\nm", "Residual Z\nm"), "F12.5"),
        Field("test", "number?", "the largest of its components", "control_test", "Test", "F8.2"),
    ),
)  # fmt: skip
AGAINST: Rows[StripAnswer, StripAnswer] = Rows(
    "against_iiia",
    "the joined triplets, from which IIIA starts, less its solution, a model after a similarity",
    of=lambda a: None if a.solution is None else a,
    fields=(
        identity("photo", "photos"),
        Field("position", "3 number", "", "chain_difference", ("X\nm", "Y\nm", "Z\nm"), "F12.5"),
        Field("sigmas", "3 number?", "in those of IIIA", lambda a: _in_sigmas(a),
              ("X\nsigmas", "Y\nsigmas", "Z\nsigmas"), "F8.2"),
        Field("attitude", "3 number", "", "chain_turn", ("X-tilt\narc sec", "Y-tilt\narc sec", "Heading\narc sec"),
              "F11.2"),
    ),
)  # fmt: skip
RECORD: tuple[Node[Any], ...] = (
    *(JOB, VERDICT, FIT, STRIP_PLANE, TRIPLETS, JOINS, CONTROL, STATIONS, POINTS, LEFT_OUT, AGAINST),
)


def _in_sigmas(answer: StripAnswer) -> Any:
    sigma = answer.position_sigma
    return answer.chain_difference / np.where(sigma > 0.0, sigma, np.nan)


DOCUMENT: Document[StripAnswer] = Document(
    name="strip_version", version="3.0", title="musatpy strip", about=_ABOUT, nodes=RECORD
)


# --- the listing ---

TRIPLET_TABLE = Report("Triplets And Their Planes Of Water", TRIPLETS)
JOIN_TABLE = Report("Joins Of The Triplets", JOINS)
CONTROL_TABLE = Report("Control Of The Strip", CONTROL)
AGAINST_TABLE = Report("The Joined Triplets Less IIIA", AGAINST)
STATED = (TRIPLET_TABLE, JOIN_TABLE, CONTROL_TABLE, AGAINST_TABLE)


def sections_of(answer: StripAnswer) -> list[Section]:
    """Return what the listing says, section by section."""
    adjusted, has_solution = "no, first values without sigmas", answer.solution is not None
    if has_solution:
        worst = float(np.nanmax(np.abs(_in_sigmas(answer)), initial=0.0))
        largest = float(np.abs(answer.chain_difference).max())
        adjusted = f"yes, from joined triplets that are off by up to {largest:.5g} m, {worst:.2f} sigmas"
    short = {
        "Triplets, joins": f"{len(answer.strip.triplets)}, {len(answer.strip.joins)}",
        "Redundancy": str(answer.redundancy),
        "Sigma0": sigma0_text(answer.sigma0, answer.fits),
        "Adjusted by IIIA": adjusted,
    }
    return [
        *first_sections(answer, short, has_plane=has_solution),
        TRIPLET_TABLE.section(answer, _NOTE, new_page=True),
        JOIN_TABLE.section(answer),
        *filled([CONTROL_TABLE], answer),
        POINT_TABLE.section(answer, new_page=True),
        *filled([LEFT_OUT_TABLE], answer),
        *([AGAINST_TABLE.section(answer, new_page=True)] if has_solution else []),
    ]


def study_text(study: OrientationStudy, title: str, limit: float) -> str:
    """Return the study; the plane counts as determined up to a `limit` of the mean depth."""
    lines = [
        f"STUDY OF AN ORIENTATION THROUGH WATER: {title}",
        f"Method {study.oriented.method.name}; H is the height of the cameras over the water",
        "",
        "Random starts around the solution, by the standard deviations of their errors",
        "",
        *sheet(
            ("Angles\ndegrees", "F8.1", 5.0 * DEGREE * study.basins.levels),
            ("Lengths\nof H", "F8.2", 0.1 * study.basins.levels),
            ("Slopes", "F8.3", 0.05 * study.basins.levels),
            ("Starts", "I6", [study.basins.outcomes.shape[1]] * len(study.basins.levels)),
            ("To this\nsolution, %", "F12.1", 100.0 * study.basins.shares[:, 0]),
            ("To another\nsolution, %", "F12.1", 100.0 * study.basins.shares[:, 1]),
            ("To none\n%", "F8.1", 100.0 * study.basins.shares[:, 2]),
        ).text(),
    ]
    squares = [f"{number + 1}: {square:.4g}" for number, square in enumerate(study.basins.squares.tolist())]
    if squares:
        lines += ["", f"Other solutions, weighted squares of images without errors: {', '.join(squares)}"]
    if study.precision is not None:
        lines += ["", *_precision(study.precision, limit)]
    return text_of(lines)


def _precision(precision: LevelPrecision, limit: float) -> list[str]:
    """Return the sigma of the level over the mean depth, by depth and share of dry points."""
    ratio = precision.sigma / precision.depths[:, None]
    heads = [f"{100.0 * share:.0f} % dry" for share in precision.shares]
    table = sheet(("Mean depth\nof H", "F10.3", precision.depths), (heads, "F9.3", ratio))
    at_hand = number_text("F9.3", precision.at_hand / precision.depth)
    return [
        "Sigma of the level of the water over the mean depth, were the points as deep as that, and so many dry",
        "",
        *table.text(),
        "",
        f"At hand: depth {precision.depth:.3g} of H, {100.0 * precision.share:.0f} % dry: {at_hand} of the depth",
        f"The plane of water counts as determined up to {limit:g}; blank where a point would not show",
    ]
