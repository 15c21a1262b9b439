"""The bottom as a picture: contours over shaded depth, with the points (the extra `plots`)."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.canvas import new_figure, png
from musatpy.compilation.bottom import Bottom

_PANEL = 6.0  # inches


def contour_picture(bottoms: Sequence[Bottom], title: str, datum: str) -> bytes:
    """Return a PNG of the models side by side, north up. Raises `MusatError` where matplotlib is missing."""
    shown = [bottom for bottom in bottoms if bottom.tin is not None]
    figure = new_figure(_PANEL * max(len(shown), 1), _PANEL)
    figure.suptitle(f"{title}: depths below {datum}, m")
    deepest = max((float(bottom.tin.z.max()) for bottom in shown if bottom.tin), default=1.0)
    least = min((float(bottom.tin.z.min()) for bottom in shown if bottom.tin), default=0.0)
    for number, bottom in enumerate(shown, 1):
        axes = figure.add_subplot(1, len(shown), number, aspect="equal")
        tin = bottom.tin
        assert tin is not None
        shade = axes.tripcolor(
            *tin.xy.T, tin.z, triangles=tin.triangles[tin.kept], shading="gouraud", cmap="Blues", vmin=least,
            vmax=deepest,
        )  # fmt: skip
        for line in bottom.lines.lines:
            axes.plot(*line.xy.T, color="0.15", linewidth=1.6 if line.index else 0.7)
            if line.index:
                middle = line.xy[len(line.xy) // 2]
                axes.annotate(
                    f"{line.level:g}", middle, fontsize=8, ha="center", va="center", backgroundcolor="white"
                )
        axes.plot(*tin.xy.T, ".", color="tab:orange", markersize=3)
        axes.set_title(f"model {bottom.model.name}")
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")
        if number == len(shown):
            figure.colorbar(shade, ax=axes, label="depth, m")
    return png(figure)
