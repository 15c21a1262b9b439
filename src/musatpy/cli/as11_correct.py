"""`musat as11 correct`: points, lines or a grid of an old compilation through the water."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import complain_of_each, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, refuse_overwriting, strict_option


@click.command(name="correct", short_help="Correct an old compilation.")
@click.argument("run", type=NamedPath())
@click.argument("left")
@click.argument("right")
@click.argument("source", type=NamedPath())
@click.option(
    "-o", "--out", "target", type=NamedPath(), required=True, help="What to write; the suffix is the format."
)
@anyway_option
@strict_option
@click.option("--crs", default="", help="System of the points: a code, PROJ string or WKT.")
@click.option("--geoid", default="", help="Grid file of the geoid above which their heights are.")
@click.option("--layer", default="", help="Of a GeoPackage of several.")
@click.option("--band", default="", help="Band of a raster that has the heights, if it has several.")
@click.option(
    "--pointing", type=click.FloatRange(min=0.0, min_open=True), default=None,
    help="Sigma of an image coordinate, um. Default: that of the plates of the run.",
)  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context,
    run: Path,
    left: str,
    right: str,
    source: Path,
    target: Path,
    crs: str,
    geoid: str,
    layer: str,
    band: str,
    pointing: float | None,
    anyway: bool,
    strict: bool,
) -> None:
    """Correct apparent points, lines or a grid of heights in SOURCE, of the model of photos LEFT and RIGHT.

    RUN.json is the record of a run. Formats: .csv, .xyz, .las, .laz, .tif, .gpkg, .geojson, .dxf. Without a system
    coordinates are longitude and latitude in degrees on the ellipsoid of the run; those of a local job are its own.

    Exit status: 0 corrected, 1 the run or the file cannot be used, 4 rejected: nothing is corrected (with --strict:
    or doubtful).
    """
    from musatpy.as11_corrections import correct_file
    from musatpy.runs import ExitStatus

    refuse_overwriting([target], [run, source])
    done = correct_file(
        run,
        (left, right),
        source,
        target,
        anyway=anyway,
        crs=crs,
        geoid=geoid,
        layer=layer,
        band=band,
        pointing=pointing,
    )
    complain_of_each(source, done.warnings())
    for line in done.lines():
        tell(f"{name_of(target)}: {line}")
    ctx.exit(ExitStatus.of(done.verdict.grade, strict=strict))
