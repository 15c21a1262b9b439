"""`musat as11 drive`: a path of the mark through the real-time loop."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import complain, count_of, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, out_option, refuse_overwriting


@click.command(name="drive", short_help="Drive the mark along a path.")
@click.argument("run", type=NamedPath())
@click.argument("left")
@click.argument("right")
@click.argument("path", type=NamedPath())
@out_option
@anyway_option
@click.option("--air", is_flag=True, help="The mark is where straight rays meet, not the true point.")
@click.option("--job", "of_job", is_flag=True, help="The path is in the system of the job (lat, lon, height).")
@click.option(
    "--rate",
    type=click.FloatRange(min=0.0, max=1000.0, min_open=True),
    default=50.0,
    show_default=True,
    help="Cycles a second.",
)
def command(
    run: Path,
    left: str,
    right: str,
    path: Path,
    out_dir: Path | None,
    anyway: bool,
    air: bool,
    of_job: bool,
    rate: float,
) -> None:
    """Drive the mark along PATH in the stereomodel of photos LEFT and RIGHT of RUN.json.

    PATH is a CSV file with columns t (s), X, Y, Z (m in the model), or those of the job: lat, lon (degrees) and
    height (m), or X, Y, Z of a local one. PATH.stages.csv has both stages at every cycle: refined plate
    coordinates.
    """
    import numpy as np

    from musatpy.as11_runs import run_of
    from musatpy.compilation.loop import Drive, Loop, driven, driven_csv, read_path
    from musatpy.compilation.stereomodels import set_up
    from musatpy.files import write_files

    target = (path.parent if out_dir is None else out_dir) / f"{path.stem}.stages.csv"
    refuse_overwriting([target], [run, path])
    triangulation = run_of(run, anyway)
    if triangulation.caution:
        complain(f"{name_of(run)}: {triangulation.caution}")
    stereo = set_up(triangulation, left, right)
    loop = Loop(stereo=stereo, drive=Drive.AIR if air else Drive.TRUE)
    result = driven(loop, read_path(path, stereo, of_job=of_job), rate)
    write_files({target: driven_csv(result).encode()})
    if len(off := result.off(loop)):
        cycles = count_of(len(off), "cycle")
        complain(f"{name_of(path)}: {cycles} off the plates, t = {off[0]:g} to {off[-1]:g} s")
    late = f"{1e3 * np.quantile(result.seconds, 0.99):.2f} ms, at most {1e3 * result.seconds.max():.2f}"
    tell(
        f"{name_of(target)}: {len(result.t)} cycles at {rate:g} Hz, {result.missed} missed; 99 % within {late} ms; "
        f"stages up to {result.speed:.3f} mm/s"
    )
