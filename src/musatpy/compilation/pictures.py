"""The bottom as a picture: contours over shaded depth, with points and stations (the extra `plots`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.compilation.bottom import Bottom
from musatpy.compilation.compiled import Compiled
from musatpy.compilation.joined_surfaces import Of, Surface
from musatpy.figures import image_of, new_figure, styled
from musatpy.surfaces.contours import Contour

_PANEL = 6.0  # inches
_BESIDE, _ABOVE = 1.8, 1.2  # inches: bar and numbers beside a map, title and numbers above and below it


@styled
def contour_pictures(compiled: Compiled, bottom: Bottom) -> dict[str, bytes]:
    """Return the surfaces side by side, north up, as `png` and `pdf`. Raises `MusatError` without matplotlib."""
    shown = [(surface, _lines_of(bottom, surface)) for surface in bottom.surfaces if surface.tin is not None]
    figure = new_figure(_PANEL * max(len(shown), 1), _PANEL)
    title = compiled.deck.titles[0] if compiled.deck.titles else "Bottom"
    of_depth = bottom.of is Of.DEPTH
    what = f"depths below {compiled.datum.title}" if of_depth else "heights"
    figure.suptitle(f"{title}: {what}, m", wrap=True)
    depths = np.concatenate([surface.tin.z for surface, _ in shown if surface.tin] or [np.array([0.0, 1.0])])
    shade = None
    for number, (surface, lines) in enumerate(shown, 1):
        axes = figure.add_subplot(1, len(shown), number, aspect="equal")
        limits = (float(depths.min()), float(depths.max()))
        shade = _draw(axes, surface, lines, limits, "Blues" if of_depth else "terrain")
        _draw_models(axes, compiled, surface)
    if shade is not None:
        figure.set_figheight(height_of(figure.axes))
        figure.colorbar(shade, ax=axes, label=f"{bottom.of}, m")
    return {"png": image_of(figure, "png"), "pdf": image_of(figure, "pdf")}


def height_of(maps: list[Any]) -> float:
    """Return the height (inches) of a figure whose maps are as high as it allows: the bar beside them is so too."""
    slope = max(float(np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim())) for axes in maps)
    return min(_PANEL, (_PANEL - _BESIDE) * slope + _ABOVE)


def _lines_of(bottom: Bottom, surface: Surface) -> list[Contour]:
    """Return the contours of a surface, or of the posts that are on its map."""
    return [line for sheet in bottom.sheets if sheet.surface is surface for line in sheet.contours.lines]


def _draw(axes: Any, surface: Surface, lines: list[Contour], limits: tuple[float, float], colours: str) -> Any:
    """Draw a surface with its points and contours, and return what its colours mean."""
    tin = surface.tin
    assert tin is not None
    shade = axes.tripcolor(
        *tin.xy.T, tin.z, triangles=tin.triangles[tin.kept], shading="gouraud", cmap=colours, vmin=limits[0],
        vmax=limits[1],
    )  # fmt: skip
    for line in lines:
        axes.plot(*line.xy.T, color="0.15", linewidth=1.2 if line.index else 0.5)
        if line.index:
            _label(axes, line)
    axes.plot(*tin.xy.T, ".", color="tab:orange", markersize=2)
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    return shade


def _label(axes: Any, line: Contour) -> None:
    """Write the level of a contour along its middle."""
    from matplotlib.patheffects import withStroke

    middle = len(line.xy) // 2
    way = line.xy[min(middle + 1, len(line.xy) - 1)] - line.xy[middle - 1]
    turn = np.degrees(np.arctan2(way[1], way[0]))
    axes.annotate(
        f"{line.level:g}", line.xy[middle], fontsize=7, ha="center", va="center", zorder=4,
        rotation=(turn + 90.0) % 180.0 - 90.0, path_effects=[withStroke(linewidth=2.0, foreground="white")],
    )  # fmt: skip


def _draw_models(axes: Any, compiled: Compiled, surface: Surface) -> None:
    """Draw the bases of the models of a surface, and what both photos show at the height of the origin."""
    for model in compiled.models:
        if model.name not in surface.models:
            continue
        stereo, photos = model.stereo, model.stereo.run.block.photos
        base = surface.places(photos.position[list(stereo.photos)][:, :2])
        axes.plot(*base.T, "^-", color="tab:red", markersize=7, linewidth=0.8, zorder=5)
        for row, place in zip(stereo.photos, base, strict=True):
            axes.annotate(
                str(photos.ids[row]), place, textcoords="offset points", xytext=(4, 5), fontsize=8, zorder=5
            )
        half = 0.5 * stereo.camera("format_size").min(axis=0) / stereo.camera("focal_length").mean() * stereo.height
        stations = stereo.stations[:, 0]
        west, east = stations.max() - half[0], stations.min() + half[0]
        corners = np.array([[west, -half[1]], [east, -half[1]], [east, half[1]], [west, half[1]], [west, -half[1]]])
        outline = stereo.working(np.column_stack([corners, np.zeros(5)]))
        axes.plot(*surface.places(stereo.run.frame.system(outline)[:, :2]).T, "--", color="0.5", linewidth=0.8)
