"""`musat as11 compare-contours`: compiled contours beside those of another source."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, out_option, refuse_overwriting


@click.command(name="compare-contours", short_help="Hold contours against those of another source.")
@click.argument("run", type=NamedPath())
@click.argument("bottom", type=NamedPath())
@click.argument("contours", type=NamedPath())
@out_option
@anyway_option
@click.option("--datum", type=float, default=0.0, help="How far the datum of CONTOURS is below the bottom's, m.")
@click.option(
    "--farthest",
    type=click.FloatRange(min=0.0, min_open=True),
    default=None,
    help="Contours farther than that, m, are of other places.",
)
@click.option("--crs", default="", help="Coordinate system of a file that says none: EPSG:32620.")
@click.option("--layer", default="", help="Layer of a GeoPackage that has several.")
@click.option("--depths", is_flag=True, help="Third coordinates are depths, positive down, and no heights.")
def command(
    run: Path,
    bottom: Path,
    contours: Path,
    out_dir: Path | None,
    anyway: bool,
    datum: float,
    farthest: float | None,
    crs: str,
    layer: str,
    depths: bool,
) -> None:
    """Hold contours of BOTTOM against the 3-D lines of CONTOURS, in the system of RUN.json.

    BOTTOM is a deck, which is compiled in stereomodels of the run, or a GeoTIFF with a band depth. CONTOURS is a
    DXF, GeoJSON, GeoPackage, CSV or XYZ file. Its depths are those of its column depth, or heights with the
    opposite sign. The listing goes to CONTOURS.contours.lst, the record to CONTOURS.contours.json.
    """
    import math

    from musatpy.as11_comparisons import compare_contours

    stem = (contours.parent if out_dir is None else out_dir) / f"{contours.stem}.contours"
    listing, record = (stem.with_name(f"{stem.name}.{kind}") for kind in ("lst", "json"))
    refuse_overwriting([listing, record], [run, bottom, contours])
    compared = compare_contours(
        run,
        bottom,
        contours,
        (listing, record),
        datum=datum,
        farthest=math.inf if farthest is None else farthest,
        crs=crs,
        layer=layer,
        depths=depths,
        anyway=anyway,
    )
    partners = {row.depth for row in compared.distances}
    tell(
        f"{name_of(contours)}: contours of {count_of(len(partners), 'depth')}, RMS distance {compared.rms:.2f} m, "
        f"listing {name_of(listing)}"
    )
