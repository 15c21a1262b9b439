"""What is in a job, for who is to run it, as pages of tables or JSON; what was merged and extracted, as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from musatpy.arrays import IntArray
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import Extract
from musatpy.jobs.merge import Merged
from musatpy.jobs.naming import NamedKind, Names
from musatpy.jobs.summary import NO_CONTROL, Summary, rays_histogram
from musatpy.model import Block, ControlKind, Plates
from musatpy.reports.fields import Field, Rows, identity
from musatpy.reports.pages import PAGE_WIDTH, Section, headed, labelled, page_texts, paginate, text_of, wrapped
from musatpy.reports.table import Report, Table, sheet
from musatpy.reports.values import Json, plain, rows
from musatpy.units import ARC_SECOND, MICROMETRE

_NUMBER, _ID, _CELL = 3, 8, 5  # widths of a row number, a photo, and a number of points, in the matrix
_MATRIX = (PAGE_WIDTH - _NUMBER - 1 - _ID) // _CELL  # photos for which there is room
_KINDS = {kind: kind.name.lower() for kind in ControlKind}


def list_text(job: Summary, deck: str) -> str:
    """Return what is in a job as pages of 132 columns."""
    header = headed(f"MUSAT  {deck}"[: PAGE_WIDTH - 11])
    return "".join(page_texts(paginate(sections(job)), header, carriage_control=False))


def sections(job: Summary) -> list[Section]:
    """Return the tables of a job: what it is, photos, rays, ties, control, points on one photo, flags."""
    block, plates, links = job.block, job.block.plates, job.block.control.point
    points, photos = block.points.ids, block.photos.ids
    counts, kept_out = rays_histogram(job), np.flatnonzero(~plates.triangulated)
    columns = ((name.capitalize(), "I9", counts[name]) for name in ("points", "land", "submerged", "control"))
    rays = sheet(("Rays", "I4", range(len(counts["points"]))), *columns)
    flagged = zip(points[plates.point[kept_out]], photos[plates.photo[kept_out]], strict=True)
    optional = {
        "Control": _control(job),
        "Equal Elevation Groups": _groups(job),
        "Stations And Tides That Are Observed": _observed(job),
    }
    names = {
        "Points On One Photo Only, With Nothing Known Of Them": _alone(job),
        "Measurements Flagged N: Point On Photo": [f"{point} on {photo}" for point, photo in flagged],
        "Control Measured On No Photo": points[links[job.points.rays[links] == 0]].tolist(),
    }
    return [
        Section(title="Job", lines=_job(job), together=True),
        _PHOTOS.section(job),
        _section("Rays Per Point", rays, together=True),
        Section(title="Points In Common, By Measurements Not Flagged N", lines=_ties(job)),
        Section(title="Parts Of The Job", lines=_parts(job)),
        *(section for title, table in optional.items() if (section := _section(title, table)).lines),
        *(Section(title=f"{title}: {len(of)}", lines=listed(of)) for title, of in names.items() if of),
    ]


def _section(title: str, table: Table[Any], together: bool = False) -> Section:
    return Section(title=title, head=table.head(), lines=table.lines(None), together=together)


# --- the job ---


def _job(job: Summary) -> list[str]:
    block = job.block
    options, wet, plates = block.options, block.points.bathymetric, block.plates
    sigmas = ", ".join(
        f"{sigma / MICROMETRE:g} um ({count})"
        for sigma, count in zip(job.plate_sigma.tolist(), job.plate_sigma_count.tolist(), strict=True)
    )
    kinds = np.bincount(block.control.kind, minlength=len(ControlKind)).tolist()
    control = ", ".join(f"{count} {_KINDS[ControlKind(kind)]}" for kind, count in enumerate(kinds) if count)
    between = {
        "air bases": len(block.air_bases.length),
        "distances": len(block.distances.length),
        "height differences": len(block.height_differences.difference),
    }
    unknown = zip(block.waves.ids, block.waves.unknown, strict=True)
    waves = [f"{name} (to be found)" if is_unknown else str(name) for name, is_unknown in unknown]
    facts = {
        "program, system, refraction": f"{options.program}, {options.system}, {options.refraction}",
        **_stated(block),
        "photos, cameras": f"{len(block.photos.ids)}, {len(block.cameras.ids)}",
        "points on land, submerged": f"{np.count_nonzero(~wet)}, {np.count_nonzero(wet)}",
        "plate measurements, flagged N": f"{len(plates.photo)}, {np.count_nonzero(~plates.triangulated)}",
        "sigmas of plate coordinates (how many)": sigmas or "none",
        "control points": control or "none",
        **({"waves on the water": ", ".join(waves)} if waves else {}),
        **{what: str(count) for what, count in between.items() if count},
    }
    return [*block.titles, "", *labelled(facts)] if block.titles else labelled(facts)


def _stated(block: Block) -> dict[str, str]:
    """Return the words of the cards by which a deck is stated in another system, or holds readings."""
    job = {}
    for what, spec in (("deck stated in", block.given_in), ("answer stated in", block.stated_in)):
        if spec is not None:
            geoid = f"above {spec.geoid}" if spec.geoid else ""
            job[what] = " ".join(word for word in (spec.kind, spec.definition, geoid) if word)
    if block.reduction is not None and block.reduction.plates is Plates.RAW:
        job["plate measurements are"] = "comparator readings"
    return job


# --- photos and rays ---


def _of_control(kind: int, job: Summary) -> IntArray:
    return job.photos.control[:, kind]


PHOTOS: Rows[Summary, Summary] = Rows(
    "photos", "one row per photo: rays, and points in common", (
        identity("photo", "block.photos.ids"),
        Field("camera", "string", "", lambda j: j.block.cameras.ids[j.block.photos.camera], "Camera", "A6"),
        Field("rays", "integer", "", "photos.rays", "Rays", "I6"),
        Field("land", "integer", "", "photos.land", "Land", "I6"),
        Field("submerged", "integer", "", "photos.submerged", "Subm", "I6"),
        Field("flagged_n", "integer", "", "photos.kept_out", "Flag N", "I6"),
        *(
            Field(f"control_{name}", "integer", "", partial(_of_control, kind), f"Control\n{name}", "I7")
            for kind, name in _KINDS.items()
        ),
        Field("single", "integer", "", "photos.single", "Here\nonly", "I6"),
        Field("with_next", "integer", "", "photos.with_next", "With\nnext", "I6",
              shown=lambda t: np.where(np.arange(t.count) < t.count - 1, t["with_next"], np.nan)),
        Field("neighbours", "integer", "", "photos.neighbours", "Ties to\nphotos", "I6"),
        Field("tide", "number?", "", "block.photos.tide", "Tide\nm", "F10.4"),
        Field("time", "number?", "", "block.photos.time"),
        Field("position_sigma", "3 number?", "", "block.photos.position_sigma"),
        Field("attitude_sigma", "3 number?", "", lambda j: j.block.photos.attitude_sigma / ARC_SECOND),
        Field("tide_sigma", "number?", "", "block.photos.tide_sigma"),
    ),
)  # fmt: skip
_PHOTOS = Report("Photos: Rays On Each, And Points In Common With The Next", PHOTOS)


# --- ties ---


def _ties(job: Summary) -> list[str]:
    """Return the numbers of points that photos have in common: a matrix, or of many photos lists."""
    ids, pairs = job.block.photos.ids.tolist(), job.pairs
    common: list[dict[int, int]] = [{} for _ in ids]
    for i, j, points in zip(pairs.first.tolist(), pairs.second.tolist(), pairs.points.tolist(), strict=True):
        common[i][j] = common[j][i] = points
    lines = []
    if len(ids) > _MATRIX:
        for name, others in zip(ids, common, strict=True):
            texts = [f"{ids[other]} ({points})" for other, points in sorted(others.items())]
            lines += [name, *listed(texts)] if texts else [f"{name}  tied to none"]
        return lines
    for row, (name, others) in enumerate(zip(ids, common, strict=True)):
        cells = ["-" if column == row else str(others.get(column, ".")) for column in range(len(ids))]
        lines.append(f"{row + 1:>{_NUMBER}} {name:<{_ID}}" + "".join(f"{cell:>{_CELL}}" for cell in cells))
    heads = "".join(f"{number:>{_CELL}}" for number in range(1, len(ids) + 1))
    return [f"{'':{_NUMBER + 1 + _ID}}{heads}", *lines]


def _parts(job: Summary) -> list[str]:
    block, ids = job.block, job.block.photos.ids
    lines = []
    for members, least in ((job.parts, 1), (job.strong_parts, job.few)):
        how = "a point in common" if least == 1 else f"{least} points in common"
        if len(members) == 1:
            lines += [f"All photos hang together by {how} or more."]
        else:
            lines += [f"{len(members)} parts that hang together by {how} or more:"]
            for number, names in enumerate(members, start=1):
                lines += [f"  part {number}: {len(names)} photos", *listed(names.tolist())]
    gaps = [f"{ids[i]}-{ids[i + 1]} ({job.photos.with_next[i]})" for i in job.gaps.tolist() if i + 1 < len(ids)]
    if gaps:
        lines += [
            f"Photos with fewer than {job.few} points in common with the next one of the deck:",
            *listed(gaps),
        ]
    if len(block.air_bases.photo):
        lines += ["Air bases:", *listed([f"{a}-{b}" for a, b in ids[block.air_bases.photo].tolist()])]
    return lines


# --- control ---


def _control(job: Summary) -> Table[Any]:
    control, points = job.block.control, job.block.control.point
    return sheet(
        ("Point", "A8", job.block.points.ids[points]),
        ("Kind", "A10", [_KINDS[ControlKind(kind)] for kind in control.kind]),
        ("Fixed", "A5", np.where(control.fixed, "yes", "")),
        ("Submerged", "A9", np.where(job.block.points.bathymetric[points], "yes", "")),
        ("Rays", "I4", job.points.rays[points]),
        ("Not\nflagged N", "I9", job.points.used[points]),
        ([f"Sigma {name}\nm" for name in ("east", "north", "up")], "F11.3", control.sigma),
    )


def _group_sizes(job: Summary, measured: bool) -> IntArray:
    groups = job.block.equal_elevations
    counted = groups.group[job.points.rays[groups.point] > 0] if measured else groups.group
    return np.bincount(counted, minlength=len(groups.ids))


def _groups(job: Summary) -> Table[Any]:
    groups = job.block.equal_elevations
    return sheet(
        ("Group", "A8", groups.ids),
        ("Sigma\nm", "F9.4", groups.sigma),
        ("Points", "I6", _group_sizes(job, False)),
        ("Measured", "I8", _group_sizes(job, True)),
    )


def _observed(job: Summary) -> Table[Any]:
    """Return the photos with a sigma on station, attitude or tide."""
    photos = job.block.photos
    sigmas = np.column_stack([photos.position_sigma, photos.attitude_sigma, photos.tide_sigma])
    rows = np.flatnonzero(np.isfinite(sigmas).any(axis=1))
    return sheet(
        ("Photo", "A8", photos.ids[rows]),
        ([f"{name}\nm" for name in ("East", "North", "Up")], "F9.3", photos.position_sigma[rows]),
        ([f"{name}\narc sec" for name in ("X-Tilt", "Y-Tilt", "Heading")], "F9.1", photos.attitude_sigma[rows]),
        ("Tide\nm", "F9.4", photos.tide_sigma[rows]),
        ("Group", "A8", photos.tide_group[rows]),
        ("Day", "A8", photos.tide_day[rows]),
    )


# --- names ---


def _alone(job: Summary) -> list[str]:
    """Return the points with one ray and nothing known of them, each with its photo."""
    points, block = job.points, job.block
    unknown = (points.kind == NO_CONTROL) | (points.kind == ControlKind.CHECK)
    alone = np.flatnonzero((points.rays == 1) & unknown & ~points.grouped)
    return [f"{block.points.ids[i]} on {block.photos.ids[points.only_photo[i]]}" for i in alone.tolist()]


# --- JSON ---


def list_record(job: Summary, deck: str) -> dict[str, Json]:
    """Return what is in a job as dictionaries, lists, texts and numbers: metres, millimetres, arc seconds."""
    block, points, pairs = job.block, job.points, job.pairs
    ids = block.photos.ids
    kind = ["" if number == NO_CONTROL else _KINDS[ControlKind(number)] for number in points.kind.tolist()]
    return {
        "deck": deck,
        "titles": list(block.titles),
        "options": {name: str(getattr(block.options, name)) for name in ("program", "system", "refraction")},
        "stated": {**_stated(block)},
        "waves": block.waves.ids.tolist(),
        "plate_sigmas": rows(sigma=job.plate_sigma, coordinates=job.plate_sigma_count),
        "photos": rows(**PHOTOS.raw(job)),
        "rays": {name: plain(count) for name, count in rays_histogram(job).items()},
        "overlaps": rows(first=ids[pairs.first], second=ids[pairs.second], points=pairs.points),
        "few": job.few,
        "parts": [plain(names) for names in job.parts],
        "strong_parts": [plain(names) for names in job.strong_parts],
        "points": rows(
            point=block.points.ids,
            submerged=block.points.bathymetric,
            dry=block.points.dry,
            rays=points.rays,
            not_flagged_n=points.used,
            control=kind,
            grouped=points.grouped,
        ),
        "air_bases": [plain(pair) for pair in ids[block.air_bases.photo]],
        "groups": rows(group=block.equal_elevations.ids, points=_group_sizes(job, False)),
    }


_INDENT = "    "


def merge_text(parts: Sequence[Part], names: Sequence[Names], merged: Merged) -> str:
    """Return what was merged: the parts with their new `names`, what they have in common, and what to note."""
    lines = []
    for part, new in zip(parts, names, strict=True):
        block = part.block
        lines.append(
            f"{part.name}: {len(block.photos.ids)} photos, {len(block.points.ids)} points, "
            f"{len(block.plates.photo)} measurements, {len(block.control.point)} control points"
        )
        for kind, changes in new.items():
            if changes:
                lines += named(f"  {kind}s renamed", [f"{old} > {name}" for old, name in changes.items()])
    for kind, shared in merged.shared.items():
        if kind in (NamedKind.TIDE, NamedKind.DAY):
            continue  # a note, where it means anything
        lines += named(f"{kind}s in several decks, each one {kind}", [name for name, _ in shared])
    for what, count in merged.once.items():
        lines.append(f"given alike in several decks, and kept once: {what}: {count}")
    if merged.believed:
        lines += named("given differently, and held as the preferred deck says", merged.believed)
    return text_of([*lines, *wrapped(merged.notes, lead="note: ")])


def extract_text(extract: Extract) -> str:
    """Return what an extract has not, and what to note."""
    groups = {
        **{f"{kind} left out": names for kind, names in extract.left_out.items()},
        "points left with one ray, and nothing known of them": extract.single,
        "points dropped with their only ray": extract.dropped,
    }
    lines = [line for label, names in groups.items() if names for line in named(label, names)]
    return text_of([*lines, *wrapped(extract.notes, lead="note: ")])


def named(label: str, names: Sequence[str]) -> list[str]:
    """Return a label with the number of names, and the names below it."""
    return [f"{label}: {len(names)}", *listed(names)]


def listed(names: Iterable[str]) -> list[str]:
    """Return names two blanks apart on indented lines of the width of the paper; a name is never broken."""
    lines: list[str] = []
    line = ""
    for name in names:
        if line and len(_INDENT) + len(line) + 2 + len(name) > PAGE_WIDTH:
            lines.append(_INDENT + line)
            line = ""
        line += f"  {name}" if line else name
    return [*lines, _INDENT + line] if line else lines
