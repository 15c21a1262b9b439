"""`musat import` and `musat export`: models of other programs in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from musatpy.cli.depth import NUMBER, POSITIVE, Numbers
from musatpy.cli.messages import complain, name_of, tell
from musatpy.cli.options import NamedPath, options_of, quiet_option, refuse_overwriting, water_options

_JOB = ".job"
_FORMATS = ("colmap", "opensfm", "metashape")
_import_options = options_of(
    click.option("-o", "--out", required=True, type=NamedPath(), metavar="NAME.job", help="Job to write."),
    click.option("--component", type=click.IntRange(min=1), default=None, help="Which of several components."),
    click.option("--images", type=NamedPath(), metavar="FILE",
                 help="Images of a Metashape model, in BINGO's form. Default: image.dat beside it."),
    click.option("--gcp", type=NamedPath(), metavar="FILE",
                 help="Control: gcp_list.txt, cameras.xml with markers, or a table with images."),
    click.option("--gcp-sigma", type=POSITIVE, default=0.05, show_default=True, metavar="M",
                 help="Of control whose file states none."),
    click.option("--gnss", type=NamedPath(), metavar="CSV|none",
                 help="Times and positions of the photos: what 'exiftool -csv -n' prints. "
                      "Default: positions that the model states."),
    click.option("--heights", is_flag=True, help="Take heights of positions without RTK too."),
    click.option("--lever-arm", type=Numbers(3), metavar="X,Y,Z",
                 help="From the camera to the antenna of the positions, m along the axes of the photo (z up)."),
    click.option("--crs", default="", metavar="CODE",
                 help="System of control that states none: EPSG:code[+vertical], or local."),
    click.option("--geoid", default="", metavar="GRID", help="Grid file of the geoid that its heights refer to."),
    click.option("--time-zone", default="", metavar="ZONE", help="Zone of camera clocks that state none."),
    click.option("--tide", type=NamedPath(), metavar="CSV", help="Tide: time and level."),
    click.option("--tide-datum", default="", metavar="H|GRID",
                 help="Height of the tide's zero above the ellipsoid, or a grid of such heights."),
    click.option("--tide-sigma", type=POSITIVE, metavar="M", help="Of readings whose table has none."),
    click.option("--tide-zone", default="", metavar="ZONE", help="Zone of its times that state none."),
    click.option("--level", type=NUMBER, metavar="M", help="Height of the water, where there is no tide."),
    click.option("--level-sigma", type=POSITIVE, metavar="M", help="Its standard deviation. Default 0.05."),
    water_options,
    click.option("--wet", "flags", type=NamedPath(), metavar="CSV", help="Table with id and wet of points."),
    click.option("--per-photo", type=click.IntRange(min=0), default=120, show_default=True,
                 help="Images of a photo that are kept at least; 0: all."),
    click.option("--camera", type=click.Choice(["estimated", "held"]), default="estimated", show_default=True,
                 help="Whether the adjustment estimates the lens anew."),
    click.option("--pixel-size", type=POSITIVE, metavar="UM",
                 help="Of the sensor. Default: as Metashape states it, else 2.4."),
    click.option("--image-sigma", type=POSITIVE, default=0.5, show_default=True, metavar="PX",
                 help="Sigma of an image coordinate."),
    click.option("--index", type=POSITIVE, default=1.34, show_default=True, help="Refractive index of the water."),
    click.option("--index-sigma", type=POSITIVE, help="Its standard deviation."),
    quiet_option,
)  # fmt: skip


@click.command(name="import", short_help="Import a model of COLMAP, OpenSfM or Metashape.")
@click.argument("form", metavar="FORMAT", type=click.Choice(_FORMATS))
@click.argument("path", type=NamedPath(exists=True))
@_import_options
def import_command(form: str, path: Path, out: Path, quiet: bool, **given: Any) -> None:
    """Import the model PATH, a folder or file, as a job: FORMAT is colmap, opensfm or metashape.

    The file proves its convention by the residuals of its own images; where it does not, the convention that fits
    is named, and nothing is written. The model is put in place by control (--gcp) and positions (--gnss). Points
    are wet by --wet, --water, or their heights and the level of the water. NAME.photos.csv has the time and the
    level of the water of every photo. Go on with 'musat run NAME.job'.

    Exit status: 0 written, 1 the model cannot be used.
    """
    from musatpy.files import write_files
    from musatpy.formats.job_folder import job_files
    from musatpy.sfm.importing import Asked, imported
    from musatpy.units import MICROMETRE

    if out.suffix.lower() != _JOB:
        raise click.UsageError(f"-o {name_of(out)}: a job folder is called NAME{_JOB}")
    if given["tide"] is not None and not given["tide_datum"]:
        raise click.UsageError("--tide needs --tide-datum, the height of its zero")
    if given["tide"] is None and given["level"] is None and (given["water"] or given["flags"]):
        raise click.UsageError("--water and --wet need the level of the water: --tide, or --level")
    if given["tide"] is not None and given["level"] is not None:
        raise click.UsageError("--tide and --level: one or the other")
    if given["images"] is not None and form != "metashape":
        raise click.UsageError(f"--images is of metashape: a model of {form} has its own")
    photos = out.with_name(f"{out.stem}.photos.csv")
    inputs = [given[name] for name in ("images", "gcp", "gnss", "tide", "flags") if given[name]]
    refuse_overwriting([photos], [path, *inputs])
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    options |= {"side": options.pop("water_side", ""), "held": options.pop("camera") == "held"}
    if "pixel_size" in options:
        options["pixel_size"] *= MICROMETRE
    asked = Asked(form=form, path=path, **options)
    done = imported(asked, out.stem.upper()[:68])
    for warning in done.warnings:
        complain(f"{name_of(path)}: warning: {warning}")
    contents = job_files(done.block, out, done.source, done.inputs)
    write_files({photos: done.photos_csv, **contents})
    if not quiet:
        tell("\n".join([*done.lines, f"wrote {name_of(out)} and {name_of(photos)}"]))


@click.command(name="export", short_help="Export adjusted stations and lenses to COLMAP or Metashape.")
@click.argument("form", metavar="FORMAT", type=click.Choice(("colmap", "metashape")))
@click.option("--run", required=True, type=NamedPath(exists=True), metavar="RUN.json", help="Run of the job.")
@click.option("--job", required=True, type=NamedPath(exists=True), metavar="NAME.job", help="Job of the import.")
@click.option("-o", "--out", required=True, type=NamedPath(), metavar="DIR", help="Folder to write.")
@click.option("--points", type=click.Choice(["true", "apparent"]), default="true", show_default=True,
              help="Where submerged points stand: where they are, or where straight rays meet.")  # fmt: skip
@quiet_option
def export_command(form: str, run: Path, job: Path, out: Path, points: str, quiet: bool) -> None:
    """Export the adjusted stations and lens of a run in the coordinates of the model that was imported.

    Exit status: 0 written, 1 the run does not go with the job.
    """
    from musatpy.sfm import colmap
    from musatpy.sfm.export import model_of_run, write_cameras

    model = model_of_run(run, job, apparent=points == "apparent")
    if form == "colmap":
        colmap.write_model(model, out)
    else:
        write_cameras(model, out / "cameras.xml")
    if not quiet:
        written = f"wrote {len(model.photos)} photos and {len(model.points)} points to {name_of(out)}"
        tell("\n".join([*model.notes, written]))
