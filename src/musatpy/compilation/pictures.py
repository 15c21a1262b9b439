"""The bottom as a picture: contours over shaded depth, with points and stations (the extra `plots`)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from musatpy import figures
from musatpy.compilation.bottom import Bottom
from musatpy.compilation.compiled import Compiled
from musatpy.compilation.joined_surfaces import JoinedSurface, Of
from musatpy.surfaces.contours import Contour

_PANEL = 6.0  # inches, of the width of a surface
_TALLEST = 1.5  # of the width


@figures.styled
def contour_pictures(
    compiled: Compiled, bottom: Bottom, form: figures.ImageForm = figures.FORM
) -> dict[str, bytes]:
    """Return the surfaces side by side, north up, by suffix: PNG and PDF, or as the form says.

    Raises `MusatError` without matplotlib.
    """
    shown = [(surface, surface.tin) for surface in bottom.surfaces if surface.tin is not None]
    of_depth = bottom.of is Of.DEPTH
    z = np.concatenate([tin.z for _, tin in shown] or [np.array([0.0, 1.0])])
    style = {"cmap": "Blues" if of_depth else "terrain", "vmin": float(z.min()), "vmax": float(z.max())}
    title = f"depths below {compiled.datum.title}, m" if of_depth else "heights, m"
    title = "\n".join([*compiled.deck.titles[:1], title])
    x, y = ("X", "Y") if compiled.run.ellipsoid is None else ("east", "north")
    figure, (panels,) = figures.new_panels([_PANEL] * max(len(shown), 1), [_PANEL], title)
    for axes, (surface, tin) in zip(panels, shown, strict=False):
        axes.set(aspect="equal", xlabel=f"{x}, m", ylabel=f"{y}, m")
        shade = axes.tripcolor(*tin.xy.T, tin.z, triangles=tin.triangles[tin.kept], shading="gouraud", **style)
        axes.plot(*tin.xy.T, ".", color=figures.DRY, markersize=2, label="points")
        for sheet in bottom.sheets:
            if sheet.surface is surface:  # its contours, or those of posts that are on its map
                for line in sheet.contours.lines:
                    axes.plot(*line.xy.T, color=figures.INK, linewidth=1.2 if line.index else 0.5)
                    if line.index:
                        _label(axes, line)
        _draw_models(axes, compiled, surface)
    if shown:
        slope = max(float(np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim())) for axes in figure.axes)
        below = figure.subplotpars.bottom * figure.get_figheight()
        height = below + _PANEL * min(slope, _TALLEST)
        figure.set_figheight(height)
        figure.subplots_adjust(bottom=below / height)
        figures.add_bar(axes, shade, f"{bottom.of}, m")
    figures.lay_out(figure)
    kinds = [form.kind] if form.kind else ["png", "pdf"]
    return dict(figures.image_of(figure, replace(form, kind=kind)) for kind in kinds)


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


def _draw_models(axes: Any, compiled: Compiled, surface: JoinedSurface) -> None:
    """Draw the bases of the models of a surface, and what both photos show at the height of the origin."""
    for model in compiled.models:
        if model.name not in surface.models:
            continue
        stereo, photos = model.stereo, model.stereo.run.block.photos
        base = surface.places(photos.position[list(stereo.photos)][:, :2])
        axes.plot(*base.T, "^-", color=figures.RED, markersize=7, zorder=5, label="base of a model")
        figures.write_beside(axes, base, photos.ids[list(stereo.photos)], (4, 5), zorder=5)
        half = 0.5 * stereo.camera("format_size").min(axis=0) / stereo.camera("focal_length").mean() * stereo.height
        stations = stereo.stations[:, 0]
        west, east = stations.max() - half[0], stations.min() + half[0]
        corners = np.array([[west, -half[1]], [east, -half[1]], [east, half[1]], [west, half[1]], [west, -half[1]]])
        outline = stereo.working(np.column_stack([corners, np.zeros(5)]))
        shown = surface.places(stereo.run.frame.system(outline)[:, :2])
        axes.plot(*shown.T, "--", color=figures.GREY, label="both photos")
