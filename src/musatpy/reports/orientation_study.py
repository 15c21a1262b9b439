"""The study of an orientation through the water as text: where starts lead, and what the geometry can determine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from musatpy.reports.editing import number_text
from musatpy.reports.pages import text_of
from musatpy.reports.table import sheet
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.orientation.twomedia.study import Basins, Precision, Study


def study_text(study: Study, title: str, limit: float) -> str:
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
        *_roots(study.basins),
    ]
    if study.precision is not None:
        lines += ["", *_precision(study.precision, limit)]
    return text_of(lines)


def _roots(basins: Basins) -> list[str]:
    """Return the other solutions that starts lead to."""
    texts = [f"{number + 1}: {square:.4g}" for number, square in enumerate(basins.squares.tolist())]
    return ["", f"Other solutions, weighted squares of images without errors: {', '.join(texts)}"] if texts else []


def _precision(precision: Precision, limit: float) -> list[str]:
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
