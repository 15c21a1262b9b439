"""The listing and the record of an orientation through the water (`musat orient`)."""

from __future__ import annotations

import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import CoordinateSystem, PlaneTreatment, Weights
from musatpy.orientation.twomedia.rays import PLANE_SYMBOLS, SYMBOLS
from musatpy.reports.answer import MARKS, verdict_section
from musatpy.reports.editing import ATTITUDE_SIGMAS, ATTITUDES_AS_ANGLES, number_text, position
from musatpy.reports.fields import Document, Field, FieldGroup, Node, Rows, flag, identity, of_job
from musatpy.reports.pages import Section, labelled, print_titled, wrapped
from musatpy.reports.table import Report, filled
from musatpy.units import ARC_SECOND, DEGREE

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.orienting.answer import Answer
    from musatpy.orienting.placement import Placement
    from musatpy.orienting.strip_answer import StripAnswer

_ABOUT = (
    "An orientation of photos through a plane of water (Okamoto and Mori 1974), in metres and radians; sigmas are "
    "a posteriori, null for what is held. Axes are those of the job, or of a model"
)
_NAMED = 12  # photos of which all are named
_EVERY = 12  # columns of the matrix of correlations beside each other

_SIGMAS = [f"Sigma {axis}\nm" for axis in "XYZ"]
JOB: FieldGroup[Answer, Answer] = FieldGroup(
    "job", "what was asked for", (
        Field("titles", "* string", "titles of the deck", "block.titles"),
        Field("method", "string", "of orientation", "task.spec.method"),
        Field("weights", "string", "FULL or EQUAL", "task.spec.weights"),
        Field("plane", "string", "what of the plane of water is unknown", "task.spec.plane"),
        Field("system", "string", "coordinate system, MODEL without control", lambda a: system_of(a)),
        Field("base", "number", "length of the first base of a model", "task.base", unit="m"),
    ),
)  # fmt: skip
VERDICT: FieldGroup[Answer, Answer] = FieldGroup(
    "verdict", "what the answer is worth", (
        Field("grade", "string", "ACCEPTED, DOUBTFUL or REJECTED", "verdict.grade"),
        Field("reasons", "* string", "against it", lambda a: [reason.text for reason in a.verdict.reasons]),
    ),
)  # fmt: skip
FIT: FieldGroup[Answer, Answer] = FieldGroup(
    "fit", "how the conditions fit", (
        Field("sigma0", "number?", "standard deviation of unit weight", "oriented.sigma0"),
        Field("redundancy", "integer", "conditions and priors less unknowns", "oriented.redundancy"),
        Field("fits", "boolean", "sigma0 passes its test of 99.9 %", "oriented.fits"),
        Field("condition", "number", "condition number of the scaled normals", "oriented.condition"),
    ),
)  # fmt: skip
PLANE: FieldGroup[Answer, Answer] = FieldGroup(
    "plane",
    "the plane of water Z = level + slope . (X, Y), about the middle of the axes; null where no point is under it",
    of=lambda a: None if a.task.dry else a,
    fields=(
        Field("verdict", "string", "whether the photos determine it", lambda a: a.plane[0]),
        Field("share", "number?", "sigma of the level over the points, of the mean depth; null without limit",
              lambda a: a.plane[1]),
        Field("limit", "number", "of that share", "task.spec.limit"),
        Field("slope", "2 number", "towards X and Y", lambda a: a.water[:2], unit="rad"),
        Field("slope_sigma", "2 number?", "", lambda a: a.water_sigma[:2], unit="rad"),
        Field("level", "number", "at the middle of the axes", lambda a: float(a.water[2]), unit="m"),
        Field("level_sigma", "number?", "", lambda a: float(a.water_sigma[2]), unit="m"),
        Field("index", "number", "of refraction", lambda a: float(a.water[3])),
        Field("index_sigma", "number?", "", lambda a: float(a.water_sigma[3])),
        Field("paper", "4 number", "a, b, d and N of the paper", lambda a: a.paper[-4:]),
        Field("paper_sigma", "4 number?", "", lambda a: a.paper_sigma[-4:]),
    ),
    optional=True,
)  # fmt: skip
STATIONS: Rows[Answer, Answer] = Rows(
    "stations", "the photos, in the order of the method", (
        identity("photo", "photos"),
        Field("position", "3 number", "in the system of the job, or the model", heading=position(4), exact=True),
        Field("position_sigma", "3 number?", "east, north, up, or X, Y, Z", heading=_SIGMAS, edit="F10.5"),
        Field("attitude", "3 number", "X-tilt, Y-tilt, heading", heading=ATTITUDES_AS_ANGLES, edit="S14.3"),
        Field("attitude_sigma", "3 number?", "", heading=ATTITUDE_SIGMAS, edit="F9.2"),
        Field("paper", "6 number", "phi, omega, kappa, X0, Y0, Z0 of the paper", "paper_photos", exact=True),
        Field("paper_sigma", "6 number?", "", "paper_photo_sigmas"),
    ),
)  # fmt: skip
ROOTS: Rows[Answer, Answer] = Rows(
    "other_roots", "photos of the other exact solutions of a minimum set", (
        Field("root", "integer", "number of the solution, from 1", lambda a: a.root_photos[0], "Root", "I4",
              is_id=True),
        identity("photo", lambda a: a.photos[a.root_photos[1]]),
        Field("position", "3 number", "as that of the stations", "root_stations", position(4), exact=True),
        Field("slope", "2 number", "of the water", lambda a: a.roots.slope[a.root_photos[0] - 1],
              ("Slope X", "Slope Y"), "F9.5", unit="rad"),
        Field("level", "number", "of the water", lambda a: a.roots.level[a.root_photos[0] - 1], "Level\nm",
              "F14.4"),
    ),
)  # fmt: skip
POINTS: Rows[Answer, Answer] = Rows(
    "points", "the points that conditions use", (
        identity("point", "task.sights.points"),
        flag("submerged", "flagged so", "Bath", "B", "task.sights.wet"),
        Field("control", "string", "known components", heading="Known", edit="A5"),
        flag("outlier", "left out, as it does not fit", "Out", "out", "outliers"),
        Field("rays", "integer", "that took part", heading="Rays", edit="I4"),
        Field("position", "3 number?", "control as adjusted", "point_position", position(4), exact=True),
        Field("sigma", "3 number?", "null of control", "point_sigma", _SIGMAS, "F10.5"),
        Field("depth", "number?", "under the water, negative above it", heading="Depth\nm", edit="F10.4"),
    ),
)  # fmt: skip
LEFT_OUT: Rows[Answer, Answer] = Rows(
    "left_out", "points that no condition can use", (
        identity("point", lambda a: [point for point, _ in a.task.left_out]),
        Field("reason", "string", "why", lambda a: [reason for _, reason in a.task.left_out], "Reason", "A80"),
    ),
)  # fmt: skip
IMAGES: Rows[Answer, Answer] = Rows(
    "images", "the images that took part", (
        identity("photo", lambda a: a.photos[a.oriented.sights.photo]),
        identity("point", lambda a: a.task.sights.points[a.oriented.sights.point]),
        Field("residual", "2 number", "x and y, adjusted minus measured", "residuals", ("x\num", "y\num"), "F9.2"),
        Field("redundancy", "2 number", "redundancy numbers", "oriented.image_redundancy",
              ("Redund.\nx", "Redund.\ny"), "F7.3"),
        Field("test", "2 number?", "normalised residuals", "oriented.normalised_residuals", ("Test\nx", "Test\ny"),
              "F7.2"),
    ),
)  # fmt: skip
CORRELATIONS: FieldGroup[Answer, Answer] = FieldGroup(
    "correlations", "of all unknowns", (
        Field("unknowns", "* string", "names", "names"),
        Field("matrix", "*x* number", "row by row", "correlations"),
        Field("inflation", "* number", "variance inflation factors"),
        Field("weakest", "* string", "the two weakest directions", lambda a: [d.words for d in a.oriented.weakest]),
    ),
)  # fmt: skip
RECORD: tuple[Node[Answer], ...] = (
    *(JOB, VERDICT, FIT, PLANE, STATIONS, ROOTS, POINTS, LEFT_OUT, IMAGES, CORRELATIONS),
)
DOCUMENT: Document[Answer] = Document(
    name="orientation_version", version="2.0", title="musatpy orientation", about=_ABOUT, nodes=RECORD
)


def system_of(answer: Placement) -> str:
    """Return the system of the answer."""
    return "MODEL" if answer.task.in_model else str(answer.block.options.system)


# --- the listing ---


def _units(answer: Answer) -> FloatArray:
    """Return what the elements of the paper are printed in."""
    return np.array(([DEGREE] * 3 + [1.0] * 3) * len(answer.photos) + [1.0] * 4)


STATION_TABLE: Report[Any] = Report("Exposure Stations: Positions", STATIONS, "photo position position_sigma")
ATTITUDE_TABLE: Report[Any] = Report("Exposure Stations: Attitudes", STATIONS, "photo attitude attitude_sigma")
POINT_TABLE: Report[Any] = Report("Points", POINTS, "point submerged control rays position sigma depth outlier")
IMAGE_TABLE = Report("Images: Residuals And Tests", IMAGES)
ROOT_TABLE = Report("Other Exact Solutions", ROOTS)
LEFT_OUT_TABLE: Report[Any] = Report("Points That No Condition Can Use", LEFT_OUT)
PAPER_TABLE: Report[Answer] = Report(
    title="In The Axes Of Okamoto And Mori: X, -Y And -Z, About The Middle Of The Axes",
    columns=(
        of_job("Photo", "A8", lambda a: [*np.repeat(a.photos, len(SYMBOLS)).tolist(), *[""] * len(PLANE_SYMBOLS)]),
        of_job("Symbol", "A6", lambda a: [*SYMBOLS * len(a.photos), *PLANE_SYMBOLS]),
        of_job("Value", "F18.6", lambda a: a.paper / _units(a)),
        of_job("Sigma", "F14.6", lambda a: a.paper_sigma / _units(a)),
        of_job("Unit", "A7", lambda a: [*(("deg",) * 3 + ("m",) * 3) * len(a.photos), "", "", "m", ""]),
    ),
)
STATED = (STATION_TABLE, ATTITUDE_TABLE, ROOT_TABLE, POINT_TABLE, LEFT_OUT_TABLE, IMAGE_TABLE, PAPER_TABLE)


def listing_of(
    answer: Placement, sections: list[Section], *, carriage_control: bool = False, date: datetime.date | None = None
) -> str:
    """Return the listing of an orientation from its sections, on pages of 60 lines of 132 columns."""
    title, mark = "".join(answer.block.titles[:1]), MARKS.get(answer.verdict.grade, "")
    return print_titled("ORIENTATION", title, sections, mark=mark, carriage_control=carriage_control, date=date)


def sections_of(answer: Answer) -> list[Section]:
    """Return what the listing says, section by section."""
    oriented = answer.oriented
    sigma0 = sigma0_text(oriented.sigma0, oriented.fits) if oriented.redundancy else "none, without redundancy"
    short = {
        "Unknowns, redundancy": f"{len(answer.names)}, {oriented.redundancy}",
        "Sigma0": sigma0,
        "Condition number of the scaled normals": number_text("F14.1", oriented.condition),
        "Weakest direction": oriented.weakest[0].words,
        "Next weakest direction": oriented.weakest[1].words,
    }
    return [
        *first_sections(answer, short, has_plane=not answer.task.dry),
        *filled([ROOT_TABLE], answer),
        POINT_TABLE.section(answer, new_page=True),
        *filled([LEFT_OUT_TABLE], answer),
        IMAGE_TABLE.section(answer),
        Section(title="Correlations Of The Unknowns", lines=_matrix(answer), new_page=True),
        PAPER_TABLE.section(answer),
    ]


def first_sections(answer: Answer | StripAnswer, short: dict[str, str], *, has_plane: bool) -> list[Section]:
    """Return what all orientations begin with: verdict, the task and `short` results, plane of water, stations."""
    task, system, names = answer.task, system_of(answer), answer.photos.tolist()
    asked = {
        "Method": str(task.spec.method),
        "Weights": _WEIGHTS[task.spec.weights],
        "Photos in their order": ", ".join(names if len(names) <= _NAMED else [*names[:3], "...", *names[-3:]]),
        "Axes": f"of a model, first base {task.base:g}" if system == "MODEL" else f"{system}, those of the deck",
        "Points, images": f"{len(task.points)} ({int(task.sights.wet.sum())} submerged), {len(task.plates)}",
    }
    return [
        verdict_section(answer.verdict, task.notes),
        Section(title="Orientation In Short", lines=labelled(asked | short)),
        *([Section(title="Plane Of Water", lines=_plane(answer))] if has_plane else []),
        STATION_TABLE.section(answer),
        ATTITUDE_TABLE.section(answer),
    ]


def sigma0_text(sigma0: float, fits: bool) -> str:
    """Return sigma0 and whether it passes its test."""
    return f"{number_text('F10.4', sigma0)}, {'passes' if fits else 'FAILS'} its test (99.9 %)"


_WEIGHTS = {
    Weights.FULL: "FULL by the sigmas of plates and control",
    Weights.EQUAL: "EQUAL for all conditions, those of rays that meet over base and lengths of the rays",
}
_UNKNOWN = {
    PlaneTreatment.ADJUST: "ADJUST  tilt and level are unknown",
    PlaneTreatment.LEVEL: "LEVEL  the level is unknown",
    PlaneTreatment.KNOWN: "KNOWN  as on the cards",
}


def _plane(answer: Answer | StripAnswer) -> list[str]:
    """Return the plane of water with its verdict, and what that means."""
    (verdict, share), task = answer.plane, answer.task
    lines = {"Plane": _UNKNOWN[task.spec.plane], "Verdict": verdict.upper()}
    if np.isfinite(share) and task.spec.plane is not PlaneTreatment.KNOWN:
        limit = f"{number_text('F8.4', share)}, limit {task.spec.limit:g}"
        lines["Sigma of the level over the mean depth"] = limit
    for name, row, unit, word in (
        ("Tilt towards X", 0, ARC_SECOND, " arc seconds"),
        ("Tilt towards Y", 1, ARC_SECOND, " arc seconds"),
        ("Level in the middle of the axes", 2, 1.0, " m"),
        ("Refractive index", 3, 1.0, ""),
    ):
        value, sigma = (number_text("F14.5", of[row] / unit) for of in (answer.water, answer.water_sigma))
        lines[name] = f"{value}{word}, {f'sigma {sigma}' if sigma else 'held'}"
    middle = task.axes.system(np.zeros(3))
    if answer.block.options.system is CoordinateSystem.GEOGRAPHIC:
        place = f"{middle[0] / DEGREE:.6f} {middle[1] / DEGREE:.6f}"
    else:
        place = " ".join(f"{value:.3f}" for value in middle)
    of_model = "the axes of the model, whose Z is that of its first photos, not the vertical"
    note = (
        f"Z = level + tilt . (X, Y) in {of_model if task.in_model else f'level axes at {place}'}. The plane is "
        "determined where the sigma of its level over the middle of the submerged points is at most that share of "
        "their mean depth without priors; only with its prior where it is so with them; else it is not determined, "
        "and depths are not to be used."
    )
    return [*labelled(lines), "", *wrapped([note])]


def _matrix(answer: Answer) -> list[str]:
    """Return the correlations below the diagonal, some columns beside each other."""
    names, values, lines = answer.names, answer.correlations, []
    for first in range(0, len(names), _EVERY):
        columns = range(first, min(first + _EVERY, len(names)))
        lines += ["", " " * 22 + " ".join(f"{number + 1:>7d}" for number in columns)]
        for row in range(first, len(names)):
            cells = [number_text("F7.4", values[row, column]).rjust(7) for column in columns if column < row]
            lines.append((f"{row + 1:>3d} {names[row]:<18.18}" + " ".join(cells)).rstrip())
    numbers = (number_text("F12.1", factor) for factor in answer.inflation)
    factors = ", ".join(f"{name} {number}" for name, number in zip(names, numbers, strict=True))
    return [*lines[1:], "", *wrapped([f"Variance inflation factors: {factors}"])]
