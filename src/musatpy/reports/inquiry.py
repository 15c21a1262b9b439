"""What a run knows of one point or photo, on one screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from musatpy.arrays import TextArray
from musatpy.model import Cause
from musatpy.records.inquiry import About, InquiredImages
from musatpy.reports.editing import edited, number_text
from musatpy.reports.pages import text_of, wrapped
from musatpy.reports.table import sheet
from musatpy.statistics.analyses import axes_of
from musatpy.units import ARC_SECOND, DEGREE

_IMAGES, _NEIGHBOURS, _CAUSES, _ALONE = 12, 6, 3, 12  # of each that are shown
_STATUS = {"not_determined": "without a position"}


def inquiry_text(record: Mapping[str, Any], about: About) -> str:
    """Return the screen of one point or photo of the record of a run."""
    solution, options = record["solution"], record["options"]
    sigma0 = "" if solution["sigma0"] is None else f", sigma0 {number_text('F9.4', solution['sigma0'])}"
    title = f": {record['titles'][0]}" if record["titles"] else ""
    run = f"{record['verdict']['grade']}{sigma0}, MUSAT-{options['program']}, refraction {options['refraction']}"
    lines = [f"{'PHOTO' if about.is_photo else 'POINT'} {about.name}{title}", run, ""]
    axes = axes_of(options["system"])
    lines += (_station if about.is_photo else _point)(about, options["system"], axes)
    lines += [*_images(about, axes), *_others(about, axes), *_without(about), *_causes(about), *_neighbours(about)]
    return text_of(lines)


def _point(about: About, system: str, axes: tuple[str, ...]) -> Iterator[str]:
    row = about.row
    status = _STATUS.get(row["status"], row["status"])
    reason = f": {row['reason']}" if row["reason"] else ""
    kind = "Submerged point" if row["bathymetric"] else "Point"
    yield from wrapped([f"{kind}, {status}{reason}; its position is that of {row['rays']} images"])
    yield from _position(row["position"], row["sigma"], system, axes)
    yield from _control(about, axes)
    yield from _water(about)


def _position(position: Any, sigma: Any, system: str, axes: tuple[str, ...]) -> Iterator[str]:
    if position is None or position[0] is None:
        return
    if system == "GEOG":
        names, edits = ("Latitude", "Longitude", "Height"), ("S20.5", "S20.5", "F11.3")
    else:
        names, edits = ("X", "Y", "Z"), ("F15.3",) * 3
    texts = [" ".join(number_text(edit, value).split()) for edit, value in zip(edits, position, strict=True)]
    parts = [f"{name} {text}" for name, text in zip(names, texts, strict=True)]
    yield f"{', '.join(parts)} m"
    yield _in_axes("sigma", sigma, axes)


def _in_axes(what: str, values: Any, axes: tuple[str, ...], edit: str = "F9.3", unit: str = "m") -> str:
    """Return three numbers with their names."""
    numbers = [f"{name} {_number(edit, value)}" for name, value in zip(axes, values or [None] * 3, strict=True)]
    return f"  {what}: {', '.join(numbers)} {unit}"


def _number(edit: str, value: float | None) -> str:
    """Return a number, a dash for none."""
    return "-" if value is None else number_text(edit, value) or "-"


def _control(about: About, axes: tuple[str, ...]) -> Iterator[str]:
    control, check = about.control, about.check
    if control is None:
        return
    kind = "check point" if control["kind"] == "check" else f"{control['kind']} control"
    held = ", held without error" if control["fixed"] else ""
    test = ""
    if check is not None and check["probability"] is not None:
        test = f"; as much by chance: {number_text('F7.4', check['probability'])}"
    yield _in_axes(f"{kind}{held}, adjusted minus given", control["difference"], axes) + test


def _water(about: About) -> Iterator[str]:
    water = about.water
    if water is None:
        return
    names = ("residual", "depth", "depth_sigma", "depth_no_refraction", "depth_predicted", "water_level")
    residual, depth, sigma, straight, predicted, level = (_number("F9.3", water[name]) for name in names)
    given = f", given {water['control']}: {residual} from it" if water["control"] else ""
    yield f"  depth {depth} m, sigma {sigma}{given}"
    incidence = None if water["incidence"] is None else water["incidence"] / DEGREE
    yield (
        f"  straight rays: {straight}, times the index: {predicted}; mean water level {level}, incidence "
        f"{_number('F7.1', incidence)} degrees"
    )


def _station(about: About, system: str, axes: tuple[str, ...]) -> Iterator[str]:
    row, images = about.row, about.images
    taken = int(images.triangulated.sum())
    yield f"Camera {row['camera']}; {len(images.point)} images, {taken} of them in the solution"
    yield from _position(row["position"], row["position_sigma"], system, axes)
    angles = [" ".join(text.split()) for text in edited("S20.3", row["attitude"])]
    names = ("X-tilt", "Y-tilt", "heading")
    yield ", ".join(f"{name} {text}" for name, text in zip(names, angles, strict=True))
    sigma = [None if value is None else value / ARC_SECOND for value in row["attitude_sigma"]]
    yield _in_axes("sigma", sigma, names, "F9.2", "arc seconds")
    if about.moved == about.moved:
        yield f"  {number_text('F12.3', about.moved)} m from the given station"
    if len(images.tide) and images.tide[0] == images.tide[0]:
        wet = int(np.count_nonzero(images.refraction > 0.0))
        yield f"  water at {number_text('F9.3', images.tide[0])} m, {wet} wet rays"


def _images(about: About, axes: tuple[str, ...]) -> Iterator[str]:
    """Yield the table of the images, the worst first."""
    rows = about.images.worst_first[:_IMAGES]
    if not len(rows):
        yield from ("", "No images")
        return
    more = len(about.images.point) - len(rows)
    yield from ("", f"Images{f', the worst first, and {more} more' if more else ''}", "")
    images = about.images
    of_water = [("Refr.\num", "F6.1", images.refraction), ("Water\nm", "F7.3", images.tide)]
    shown = (1 if about.is_photo else 2) if images.submerged.any() else 0
    columns = (
        ("Point", "A8", images.point) if about.is_photo else ("Photo", "A8", images.photo),
        ("", "A2", _flags(images)),
        (("Res x\num", "Res y\num"), "F6.2", images.residual),
        (("Test x", "Test y"), "F6.2", images.test),
        (("Red x", "Red y"), "F5.2", images.redundancy),
        (("Det x\num", "Det y\num"), "F6.1", images.detectable),
        ("Moves\nm", "F7.3", images.hidden),
        (_without_heads(axes), "F7.3", images.change),
        *of_water[:shown],
    )
    yield from sheet(*((heading, edit, values[rows]) for heading, edit, values in columns)).text()


def _without_heads(axes: tuple[str, ...]) -> list[str]:
    """Return the headings of what would change without each observation."""
    return [f"{'Without' if n == 0 else ''}\n{axis}" for n, axis in enumerate(axes)]


def _flags(images: InquiredImages) -> TextArray:
    """Return (k,) W for wet rays, else B for submerged points, and N for images that took no part."""
    wet = np.where(images.refraction > 0.0, "W", np.where(images.submerged, "B", " "))
    return np.char.add(wet, np.where(images.triangulated, " ", "N"))


def _others(about: About, axes: tuple[str, ...]) -> Iterator[str]:
    others = about.others
    if not others.of:
        return
    factor = np.array([kind.factor for kind in others.kind])
    yield from ("", "Other Observations", "")
    yield from sheet(
        ("Kind", "A8", [kind.label for kind in others.kind]),
        ("Of", "A17", others.of),
        ("Comp.", "A7", others.component),
        ("Unit", "A4", [kind.unit for kind in others.kind]),
        ("Residual", "F9.3", others.residual / factor),
        ("Sigma", "F8.3", others.sigma / factor),
        ("Test", "F6.2", others.test),
        ("Redund.", "F7.3", others.redundancy),
        ("Detect.", "F9.3", others.detectable / factor),
        (_without_heads(axes), "F7.3", others.change),
    ).text()


def _without(about: About) -> Iterator[str]:
    """Yield what the columns mean, and what would happen without more than one observation."""
    notes = [
        "Det: smallest error that the test of the image finds with a power of 80 %; Moves: what it does to the "
        "point. Without: predicted change, in m, of the point (or the station) where the observation is left out; "
        "blank where nothing checks it, or too little would be left. W wet ray, B submerged and dry here, N not "
        "triangulated."
    ]
    if about.alone:
        shown = ", ".join(about.alone[:_ALONE]) + (", ..." if len(about.alone) > _ALONE else "")
        notes.append(f"Without this photo {len(about.alone)} points would have no position: {shown}")
    elif (
        not about.is_photo and about.row["status"] == "triangulated" and not np.isfinite(about.images.change).any()
    ):
        notes.append(
            "Without one of its images it would have no position, or nothing would tell of an error in them"
        )
    hidden = about.hidden
    if hidden is not None and hidden["unlimited"]:
        notes.append("Nothing checks an observation of it: errors may move it without limit")
    elif hidden is not None and hidden["shift"] is not None:
        weak = ", weakly checked" if hidden["weak"] else ""
        notes.append(
            f"An error of one observation that the verdict does not see may move it by "
            f"{number_text('F11.3', hidden['shift'])} m ({number_text('F9.1', hidden['sigmas'])} sigmas{weak})"
        )
    yield ""
    yield from wrapped(notes)


def _causes(about: About) -> Iterator[str]:
    for number, cause in enumerate(about.causes[:_CAUSES]):
        if not number:
            yield ""
        yield from wrapped([f"possible cause of what does not fit: {Cause.of_row(cause)}"])


def _neighbours(about: About) -> Iterator[str]:
    around = about.neighbours
    if not len(around.ids):
        return
    shown = slice(0, _NEIGHBOURS)
    what, common = ("Photos", "Points") if about.is_photo else ("Points", "Photos")
    more = len(around.ids) - len(around.ids[shown])
    yield from ("", f"{what} Nearby{f', and {more} more' if more else ''}", "")

    columns = [
        (what[:-1], "A8", around.ids),
        ("Distance\nm", "F10.1", around.distance),
        (f"{common}\nin common", "I9", around.common),
        ("Sigma up\nm", "F8.3", around.sigma),
        *([("Depth\nm", "F8.3", around.depth)] if np.isfinite(around.depth[shown]).any() else []),
        ("Largest\ntest", "F8.2", around.test),
    ]
    yield from sheet(*((heading, edit, values[shown]) for heading, edit, values in columns)).text()
