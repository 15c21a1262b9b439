"""The pictures of records, and how they become files."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.canvas import small_png, svg
from musatpy.plots import compiled_pictures
from musatpy.plots.corrections import CORRECTIONS
from musatpy.plots.correlations import CORRELATIONS
from musatpy.plots.gnss import GNSS
from musatpy.plots.mean_residuals import MEANS
from musatpy.plots.normalised import NORMALISED
from musatpy.plots.picture import Picture
from musatpy.plots.plan import PLAN
from musatpy.plots.plate_residuals import PHOTOS
from musatpy.plots.profile import PROFILE
from musatpy.plots.redundancy import REDUNDANCY
from musatpy.plots.sigma_map import SIGMAS
from musatpy.plots.sounded import SOUNDINGS
from musatpy.plots.tables import Tables
from musatpy.plots.tides import TIDES

# Of a run, of a compilation, and of a comparison with soundings.
GALLERY: tuple[Picture[Any], ...] = (
    PLAN,
    PHOTOS,
    MEANS,
    SIGMAS,
    REDUNDANCY,
    NORMALISED,
    PROFILE,
    CORRECTIONS,
    TIDES,
    CORRELATIONS,
    GNSS,
)
COMPILED: tuple[Picture[Any], ...] = (
    compiled_pictures.DEPTHS,
    compiled_pictures.SIGMAS,
    compiled_pictures.PROFILE,
    compiled_pictures.CORRECTIONS,
    compiled_pictures.PARALLAXES,
)
SOUNDED: tuple[Picture[Any], ...] = (SOUNDINGS,)

MOST_MARKS = 2000  # of a picture that is SVG: 10,000 ellipses are 7.1 MB, and 0.5 MB as PNG


def rendered(picture: Picture[Any], tables: Tables) -> tuple[str, bytes] | None:
    """Return the suffix and the bytes of a picture of a record, None where it has nothing to show.

    SVG up to `MOST_MARKS` marks, PNG above; the same record gives the same bytes. Raises `MusatError` where
    matplotlib is missing.
    """
    figure = picture.draw(tables)
    return None if figure is None else file_of(figure, picture.name)


def file_of(figure: Any, name: str) -> tuple[str, bytes]:
    """Return the suffix and the bytes of a figure, whose ids have a name, as `rendered` does."""
    return ("svg", svg(figure, name)) if marks(figure) <= MOST_MARKS else ("png", small_png(figure))


def marks(figure: Any) -> int:
    """Return how many markers, lines, arrows, ellipses and cells a figure has."""
    return sum(_marks_of(artist) for axes in figure.axes for artist in axes.get_children())


def _marks_of(artist: Any) -> int:
    from matplotlib.collections import Collection, LineCollection, PolyCollection
    from matplotlib.lines import Line2D

    if (number := getattr(artist, "marks", None)) is not None:
        return int(number)
    if isinstance(artist, Line2D):
        return np.size(artist.get_xdata()) if artist.get_marker() not in ("", "None", " ", None) else 1
    if isinstance(artist, Collection):
        paths = len(artist.get_paths()) if isinstance(artist, LineCollection | PolyCollection) else 1
        return max(paths, len(np.atleast_2d(artist.get_offsets())))
    return 1
