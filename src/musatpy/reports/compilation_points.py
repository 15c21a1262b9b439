"""The points of a compilation, in the record and in the listing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model.tables import POSITION_UNIT
from musatpy.reports.editing import position
from musatpy.reports.fields import Each, Field, FieldGroup, Rows, flag, identity
from musatpy.reports.pages import Section, as_text
from musatpy.reports.stated import WORDS, Said, answered, place_columns, place_sigma_columns, said_of, with_answer
from musatpy.reports.table import Report, filled
from musatpy.statistics import Words
from musatpy.statistics.analyses import words_of

if TYPE_CHECKING:
    from musatpy.compilation.against_run import AgainstRun, ModelSetUp
    from musatpy.compilation.answers import FilePlaces, StatedPoints
    from musatpy.compilation.bottom import Bottom
    from musatpy.compilation.compiled import Compiled, DepthDatum
    from musatpy.compilation.profiles import CompiledProfile, ProfileScan
    from musatpy.model import Verdict

ENU_SIGMAS = [f"Sigma {axis}\nm" for axis in "ENU"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CompilationReport:
    """What is reported: a deck on its run, and what came of it."""

    compiled: Compiled
    against: Sequence[AgainstRun]  # of each model, its points beside those of the run
    warnings: Sequence[str] = ()  # what is odd about readings and models
    verdict: Verdict | None = None  # on what was compiled
    profiles: Sequence[CompiledProfile] = ()
    scans: Sequence[ProfileScan] = ()
    bottoms: Sequence[Bottom] = ()
    set_up: Sequence[ModelSetUp] = ()  # the models, where they are set up alone


def extremes(
    values: Callable[[Any], FloatArray], text: str = "depth below the datum", noun: str = " depth"
) -> list[Field[Any]]:
    """Return the least and the greatest of the values (m) of a row; null where it has none."""

    def extreme(of: Callable[[FloatArray], float], row: Any) -> float:
        known = values(row)[np.isfinite(values(row))]
        return float(of(known)) if len(known) else np.nan

    return [
        Field(name, "number?", text, partial(extreme, of), f"{name.capitalize()}{noun}\nm", "F9.3")
        for name, of in (("least", np.min), ("greatest", np.max))
    ]


POINTS: Rows[CompilationReport, Compiled] = Rows(
    "points", "one row per reading", of=lambda c: c.compiled, fields=(
        identity("model", "model_ids"),
        identity("point", "ids", text="point or feature"),
        Field("class", "string", "G, P, S, R", "kind", "Class", "A5"),
        flag("submerged", "flagged so", "Bath", "B"),
        Field("position", "3 number?", "true", "points.position", position(4), unit=POSITION_UNIT),
        Field("sigma", "3 number?", "east north up", heading=ENU_SIGMAS, edit="F8.3"),
        Field("covariance", "3x3 number?", "of east, north, up", "points.covariance", unit="m2"),
        Field("apparent", "3 number?", "where the straight rays meet", heading=position(4), unit=POSITION_UNIT),
        Field("model_position", "3 number?", "true, in the model",
              heading=[f"Model {axis}\nm" for axis in "XYZ"], edit="F10.3", exact=True),
        Field("model_apparent", "3 number?", "apparent, in the model", unit="m", exact=True),
        Field("water_level", "number?", "mean of both photos, there", "points.water_level",
              "Water\nm", "F9.3"),
        Field("depth", "number?", "below that", "points.depth", "Depth\nm", "F8.3"),
        Field("depth_sigma", "number?", "of the depth", "points.depth_sigma", "Sigma\nm", "F7.3"),
        Field("datum_depth", "number?", "below the sounding datum", heading="Below datum\nm", edit="F11.3"),
        Field("datum_depth_sigma", "number?", "of that", heading="Sigma\nm", edit="F7.3"),
        Field("incidence", "2 number?", "of wet rays, in air", "points.incidence",
              heading=("Incid. L\ndegrees", "Incid. R\ndegrees"), edit="F8.3"),
        Field("wet", "2 boolean", "the ray goes through the water", "points.wet"),
        Field("y_parallax", "number?", "by which the right image is off its epipolar curve",
              "points.y_parallax", "py\num", "F9.2"),
        Field("y_parallax_test", "number?", "over its sigma, as a normal variable", heading="Test py",
              edit="F7.2"),
        Field("remark", "string?", "why it has no depth, or a y-parallax beyond its limit", "remarks", "Remark",
              "A22"),
        Field("reason", "string?", "why it has no position", "reasons"),
    ),
)  # fmt: skip
STATED_POINTS: Rows[Compiled, tuple[Compiled, StatedPoints]] = Rows(
    "points", "one row per reading; null where the system does not reach",
    of=lambda c: _stated(c), fields=(
        Field("model", "string", "model id", lambda a: a[0].model_ids),
        Field("point", "string", "point or feature", lambda a: a[0].ids),
        Field("position", "3 number?", "true", lambda a: a[1].position, unit="that of the coordinates", exact=True),
        Field("covariance", "3x3 number?", "of that", lambda a: a[1].covariance,
              unit="that of the coordinates, squared", exact=True),
        Field("apparent", "3 number?", "where straight rays meet", lambda a: a[1].apparent,
              unit="that of the coordinates", exact=True),
    ),
)  # fmt: skip
ANSWER: FieldGroup[CompilationReport, Compiled] = FieldGroup(
    "stated",
    "the points as the run states its answer (SYS OUT); null where that is in the system of the job",
    of=lambda c: None if c.compiled.run.stated is None else c.compiled,
    fields=(
        FieldGroup[Any, Words]("answer", "how it is stated", of=lambda c: _words(c), fields=WORDS),
        STATED_POINTS,
    ),
    optional=True,
)


def _stated(compiled: Compiled) -> tuple[Compiled, StatedPoints] | None:
    from musatpy.compilation.answers import stated_points  # few runs do

    points = stated_points(compiled)
    return None if points is None else (compiled, points)


def _words(compiled: Compiled) -> Words | None:
    return words_of(compiled.run.stated, compiled.run.block)


POINT_TABLE = Report(
    "Point Compilation: True Coordinates",
    POINTS,
    "model point class submerged position sigma depth depth_sigma",
    worst=lambda t: np.linalg.norm(t["sigma"], axis=1),
)
APPARENT_TABLE = Report(
    "Point Compilation: Apparent Coordinates, And True Ones In The Model",
    POINTS,
    "model point apparent model_position",
)
RAY_TABLE = Report(
    "Point Compilation: Water And Rays",
    POINTS,
    (
        "model point water_level datum_depth datum_depth_sigma incidence",
        POINTS.column("wet[0]", "Wet\nleft", "A4", words={True: "W", False: ""}),
        POINTS.column("wet[1]", "Wet\nright", "A5", words={True: "W", False: ""}),
        "y_parallax y_parallax_test remark",
    ),
    worst=lambda t: np.abs(t["y_parallax_test"]),
)
# What the answer of the run is stated in: the record has it in words of its own.
ANSWER_TABLES: tuple[Report[Any], Report[Any]] = (
    Report(title="Point Compilation: True Coordinates Of The Answer", columns=()),
    Report(title="Point Compilation: Apparent Coordinates Of The Answer", columns=()),
)


PROFILES: Each[CompilationReport, CompiledProfile] = Each(
    "profiles", "one row per profile, of scans per line", of=lambda c: c.profiles, fields=(
        identity("model", "model"),
        identity("profile", "name"),
        Field("line", "integer", "number in a scan, 1 of a single one, 0 of what is on none", heading="Line",
              edit="I4", is_id=True),
        Field("readings", "integer", "with a position", lambda p: len(p.rows), "Readings", "I8"),
        Field("spikes", "integer", "readings beside the median of seven", lambda p: _number(p, "spike"), "Spikes",
              "I6"),
        Field("needed", "integer", "readings that thinning keeps", lambda p: _number(p, "kept"), "Needed", "I6"),
        Field("length", "number?", "from the first to the last reading",
              lambda p: float(np.ptp(p.profile.station)) if p.profile else np.nan, "Length\nm", "F10.2"),
        *extremes(lambda p: p.profile.value[~p.profile.spike] if p.profile else np.zeros(0)),
        Field("timed", "integer", "readings with a time", lambda p: int(np.isfinite(p.time).sum()), "Timed", "I6"),
        Field("duration", "number?", "from the first time to the last", lambda p: p.pace[0], "Time\ns", "F9.2"),
        Field("speed", "number?", "mean, of the faster stage", lambda p: p.pace[1], "Mean speed\nmm/s", "F10.3",
              unit="mm/s"),
        Field("fastest", "number?", "speed of a stage between two readings", lambda p: p.pace[2], "Largest\nmm/s",
              "F8.3", unit="mm/s"),
        Field("turns", "integer", "times that the mark went back along the line", heading="Turns", edit="I5"),
        Field("reason", "string", "why there is none; empty where there is", heading="Without, because",
              edit="A38"),
    ),
)  # fmt: skip
SCANS: Each[CompilationReport, ProfileScan] = Each(
    "scans", "one row per profile of several lines", of=lambda c: c.scans, fields=(
        identity("model", "model"),
        identity("profile", "name"),
        Field("along", "string", "axis of the model", "scan", "Along", "A5"),
        Field("lines", "integer", "number", lambda s: len(s.lines), "Lines", "I5"),
        Field("spacing", "number", "of the lines", heading="Spacing\nm", edit="F8.1"),
        Field("readings", "integer", "on the lines", lambda s: sum(len(line.rows) for line in s.lines), "Readings",
              "I8"),
    ),
)  # fmt: skip


def _number(part: CompiledProfile, name: str) -> int:
    return 0 if part.profile is None else int(getattr(part.profile, name).sum())


PROFILE_TABLE = Report(
    "Profile Compilation", PROFILES, "model profile line readings spikes needed length least greatest reason"
)
PACE_TABLE = Report(
    "Pace Of Profiles",
    PROFILES,
    "model profile line timed duration speed fastest turns",
    which=lambda t: np.flatnonzero(t["timed"] > 0),
)
SCAN_TABLE = Report("Scans By Profiles Side By Side", SCANS)
OF_PROFILES = (PROFILE_TABLE, PACE_TABLE, SCAN_TABLE)


def profile_sections(done: CompilationReport) -> list[Section]:
    """Return the tables, and the spikes; nothing without profiles."""
    if not done.profiles:
        return []
    spikes = [
        f"Model {part.model}, profile {part.name}{f', line {part.line}' * (part.line != 1)}, "
        f"station {station:.2f} m: depth {value:.3f} m"
        for part in done.profiles
        if (of := part.profile) is not None
        for station, value in zip(of.station[of.spike], of.value[of.spike], strict=True)
    ]
    return [
        PROFILE_TABLE.section(done, new_page=True),
        *filled([PACE_TABLE, SCAN_TABLE], done),
        *([Section(title="Spikes Of Profiles", lines=spikes)] if spikes else []),
    ]


def profiles_csv(profiles: Sequence[CompiledProfile], places: FilePlaces, datum: DepthDatum) -> str:
    """Return the readings of profiles, and the depths at even steps, as comma-separated values.

    What a row is stands first: a reading, a spike, a reading that thinning does not need, or a post.
    """
    lines = [f"row,model,profile,line,station,offset,depth,sigma,{places.heading}"]

    def add(part: CompiledProfile, names: list[str], numbers: Any, position: FloatArray) -> None:
        head = f"{as_text(part.model)},{as_text(part.name)},{part.line}"
        rows = zip(names, np.column_stack(numbers).tolist(), places.texts(position), strict=True)
        lines.extend(
            f"{name},{head},{','.join(f'{value:.3f}' for value in values)},{text}" for name, values, text in rows
        )

    for part in profiles:
        done = part.profile
        if done is None:
            continue
        names = np.where(done.spike, "spike", np.where(done.kept, "reading", "not needed"))
        add(part, names.tolist(), (done.station, done.offset, done.value, part.sigma), part.position)
        stations, depths, sigmas, position = part.posts(datum)
        add(part, ["post"] * len(stations), (stations, np.zeros(len(stations)), depths, sigmas), position)
    return "\n".join(lines) + "\n"


STATED = (POINT_TABLE, *ANSWER_TABLES, APPARENT_TABLE, RAY_TABLE, *OF_PROFILES)


def point_sections(done: CompilationReport) -> list[Section]:
    """Return the tables of points."""
    words, answer = _words(done.compiled), list[Section]()
    if words is not None:
        stated = {"points": STATED_POINTS.raw(done.compiled)}
        content = answered({"points": POINTS.raw(done), "stated": stated}, "points")
        answer = [report.section(report.read(content, "")) for report in in_words(said_of(words))]
    return [
        POINT_TABLE.section(done, new_page=True),
        *answer[:1],
        APPARENT_TABLE.section(done),
        *answer[1:],
        RAY_TABLE.section(done),
    ]


def in_words(said: Said) -> list[Report[Any]]:
    """Return the tables of the points as an answer is stated: of a table that is `answered`."""
    table = with_answer(POINTS, STATED_POINTS)
    true = (*place_columns(said, "position", 3), *place_sigma_columns(said, "sigma"))
    columns = (true, place_columns(said, "apparent", 3))
    return [
        replace(report, table=table, columns=("model", "point", *places), worst=POINT_TABLE.worst)
        for report, places in zip(ANSWER_TABLES, columns, strict=True)
    ]
