"""`musat as11 compare-contours`: compiled contours beside those of another source."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, out_option, refuse_overwriting


@click.command(name="compare-contours", short_help="Hold the contours of a deck against those of another source.")
@click.argument("run", type=NamedPath())
@click.argument("deck", type=NamedPath())
@click.argument("contours", type=NamedPath())
@out_option
@anyway_option
@click.option("--datum", type=float, default=0.0, help="How far the datum of CONTOURS is below the deck's, m.")
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
    deck: Path,
    contours: Path,
    out_dir: Path | None,
    anyway: bool,
    datum: float,
    farthest: float | None,
    crs: str,
    layer: str,
    depths: bool,
) -> None:
    """Compile DECK in stereomodels of RUN.json, and hold contours of its bottom against the 3-D lines of CONTOURS.

    CONTOURS is a DXF, GeoJSON, GeoPackage, CSV or XYZ file. Its depths are those of its column depth, or heights
    with the opposite sign. The listing goes to CONTOURS.contours.lst, the record to CONTOURS.contours.json.
    """
    import math

    from musatpy.as11_runs import compiled_deck
    from musatpy.compilation.bottom import bottom_of
    from musatpy.compilation.contoured import contoured
    from musatpy.compilation.joined_surfaces import surfaces_of
    from musatpy.files import write_files
    from musatpy.reports import contour_comparison as report
    from musatpy.reports.record import dumps
    from musatpy.soundings.contour_files import read_contours

    stem = (contours.parent if out_dir is None else out_dir) / f"{contours.stem}.contours"
    listing, record = (stem.with_name(f"{stem.name}.{kind}") for kind in ("lst", "json"))
    refuse_overwriting([listing, record], [run, deck, contours])
    result, _ = compiled_deck(run, deck, anyway)
    other = read_contours(contours, result.run.ellipsoid, crs=crs, layer=layer, depths=depths)
    bottom = bottom_of(result)
    levels = {line.level for sheet in bottom.sheets for line in sheet.contours.lines} if bottom else set()
    surfaces = bottom.surfaces if bottom else surfaces_of(result)[0]
    compared = contoured(surfaces, other, datum, sorted(levels), math.inf if farthest is None else farthest)
    partners = {row.depth for row in compared.distances}
    if not partners:
        why = next((row.reason for row in compared.areas), "there is no bottom")
        raise click.ClickException(f"no contour has a partner: {why}")
    title = result.deck.titles[0] if result.deck.titles else ""
    text, values = report.listing_of(compared, title, result.run.caution), dumps(report.record_of(compared))
    write_files({listing: text.encode(), record: values.encode()})
    tell(
        f"{name_of(contours)}: contours of {count_of(len(partners), 'depth')}, RMS distance {compared.rms:.2f} m, "
        f"listing {name_of(listing)}"
    )
