"""Options of `musat sea` about points and the pair that they come from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import POSITIVE, Numbers
from musatpy.cli.messages import count_of, name_of
from musatpy.cli.options import columns_option, options_of, quiet_option

if TYPE_CHECKING:
    from musatpy.depth.cameras import CameraStations
    from musatpy.sea.stereo.point_records import PointPrecision


class SigmaOption(Numbers):
    """Sigmas of three coordinates, or one of all."""

    name = "sigmas"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the three sigmas of a text."""
        sigmas = super().convert(value, param, ctx)
        if len(sigmas) not in (1, 3):
            self.fail(f"1 or 3 numbers are needed, not {len(sigmas)}", param, ctx)
        if min(sigmas) <= 0.0:
            self.fail("a sigma is greater than zero", param, ctx)
        return sigmas * (3 // len(sigmas))


precision_options = options_of(
    click.option(
        "--sigma",
        type=SigmaOption(),
        metavar="M|X,Y,Z",
        help="Sigma of points that have none of their own: one for all coordinates, or one for each.",
    ),
    click.option(
        "--image-sigma", type=POSITIVE, metavar="UM", help="Sigma of plate coordinates; replaces --sigma."
    ),
    columns_option,
    quiet_option,
    click.option("--focal", type=POSITIVE, metavar="MM", help="Focal length of the pair, with --image-sigma."),
    click.option("--pair", metavar="LEFT,RIGHT", help="Names of the two stations, if there are more."),
    click.option("--only", multiple=True, metavar="PATTERN", help="Use only points with such names, as 'W*'."),
)


def pair_by(path: Path, chosen: str | None) -> CameraStations:
    """Return the cameras of the two stations of a pair. Raises `DepthError`, `OSError`."""
    from musatpy.depth.cameras import RECORD, read_cameras, read_run

    cameras = read_run(path, water=False) if path.suffix.lower() == RECORD else read_cameras(path, water=False)
    if not chosen:
        if len(cameras.names) != 2:
            raise click.UsageError(
                f"{count_of(len(cameras.names), 'station')} in {name_of(path)}: --pair says which two"
            )
        return cameras
    names = [name.strip() for name in chosen.split(",")]
    if len(names) != 2 or len(set(names)) != 2:
        raise click.UsageError(f"--pair: two names are needed, not '{chosen}'")
    for name in names:
        if name not in cameras.names:
            raise click.UsageError(f"--pair: no station {name} among {', '.join(cameras.names)}")
    return cameras.only([cameras.names.index(name) for name in names])


def precision_by(given: dict[str, Any], pair: Any) -> PointPrecision:
    """Return how precise points are by the options, and by the cameras of their pair where they are known."""
    from musatpy.sea.stereo.point_records import PointPrecision

    sigma, image, focal = (given[name] for name in ("sigma", "image_sigma", "focal"))
    if (image is None) != (focal is None):
        raise click.UsageError("--image-sigma and --focal go together")
    if sigma is not None and image is not None:
        raise click.UsageError("--sigma and --image-sigma: one or the other")
    if sigma is not None:
        return PointPrecision(sigma=sigma)
    if image is None:
        return PointPrecision()
    if pair is None:
        raise click.UsageError("--image-sigma needs --cameras")
    return PointPrecision(cameras=pair.stations.position, image_sigma=image * 1e-3 / focal)
