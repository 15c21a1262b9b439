"""`musat as11 contours`: contours of a raster of depths."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import NamedPath, refuse_overwriting


@click.command(name="contours", short_help="Draw contours of a raster of depths.")
@click.argument("raster", type=NamedPath())
@click.option(
    "-o", "--out", "targets", type=NamedPath(), required=True, multiple=True,
    help="What to write, by the suffix: .gpkg, .dxf, .geojson. May be given several times.",
)  # fmt: skip
@click.option(
    "--interval", type=click.FloatRange(min=0.0, min_open=True), default=None, help="Between contours, m."
)
@click.option("--depth", "levels", type=float, multiple=True, help="Of a contour, m. May be given several times.")
@click.option("--index", type=click.IntRange(min=1), default=5, show_default=True, help="Every so many is thick.")
@click.option("--shortest", type=click.FloatRange(min=0.0), default=0.0, help="Shorter pieces are left out, m.")
@click.option("--band", default="", help="Of the raster. Default: depth, or the only one.")
@click.option(
    "--datum", type=float, default=None, help="Contours are depths below that height of a band of heights."
)
@click.option("--crs", default="", help="System of a raster that says none.")
def command(
    raster: Path,
    targets: tuple[Path, ...],
    interval: float | None,
    levels: tuple[float, ...],
    index: int,
    shortest: float,
    band: str,
    datum: float | None,
    crs: str,
) -> None:
    """Draw contours of RASTER, as `musat correct --surface` and the grids of `musat as11 compile` have them.

    Lines are 3-D, at the heights of their depths, with these as a column or, in DXF, as layers.
    """
    from musatpy.compilation.rasters import ContourWish, contour_raster

    if (interval is None) == (not levels):
        raise click.UsageError("give --interval, or --depth for each contour")
    refuse_overwriting(targets, [raster])
    wish = ContourWish(interval=interval or 0.0, levels=levels, index=index, shortest=shortest, datum=datum)
    drawn, what = contour_raster(raster, targets, wish, band=band, crs=crs)
    lines = drawn.lines
    depths = count_of(len({line.level for line in lines}), what.removesuffix("s"))
    length = sum(line.length for line in lines)
    left_out = f", {count_of(drawn.dropped, 'piece')} left out" if drawn.dropped else ""
    for target in targets:
        tell(f"{name_of(target)}: {count_of(len(lines), 'line')} of {depths}, {length:.0f} m{left_out}")
