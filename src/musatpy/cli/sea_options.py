"""Options of `musat sea` about points and the pair that they come from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import POSITIVE, Numbers

if TYPE_CHECKING:
    from musatpy.seasurface.reading import Precision

precision_options = (
    click.option("--sigma", type=Numbers(3), metavar="X,Y,Z", help="Of all points (m), where the file has none."),
    click.option("--image-sigma", type=POSITIVE, metavar="UM", help="Or that of plate coordinates, by the pair."),
    click.option("--focal", type=POSITIVE, metavar="MM", help="Focal length, with --image-sigma."),
    click.option("--pair", metavar="LEFT,RIGHT", help="Names of the two stations, where the file has more."),
    click.option("--only", multiple=True, metavar="PATTERN", help="Only points of such ids, as 'W*'."),
)


def pair_by(path: Path, given: dict[str, Any]) -> Any:
    """Return the two stations (2, 3) m of a file of cameras. Raises `DepthError`, `OSError`."""
    from musatpy.depth.cameras import read_cameras

    cameras = read_cameras(path, water=False)
    if given["pair"] is None:
        if len(cameras.names) != 2:
            raise click.UsageError(f"{len(cameras.names)} stations: --pair says which two are the pair")
        return cameras.stations.position
    names = [name.strip() for name in given["pair"].split(",")]
    if len(names) != 2 or len(set(names)) != 2:
        raise click.UsageError(f"--pair: two names are needed, not '{given['pair']}'")
    for name in names:
        if name not in cameras.names:
            raise click.UsageError(f"--pair: no station {name} among {', '.join(cameras.names)}")
    return cameras.stations.position[[cameras.names.index(name) for name in names]]


def precision_by(given: dict[str, Any], stations: Any) -> Precision:
    """Return how precise points are by the options; stations (2, 3) where they are known, else None."""
    from musatpy.seasurface.reading import Precision

    sigma, image, focal = (given[name] for name in ("sigma", "image_sigma", "focal"))
    if (image is None) != (focal is None):
        raise click.UsageError("--image-sigma and --focal go together")
    if sigma is not None and image is not None:
        raise click.UsageError("--sigma and --image-sigma: one or the other")
    if sigma is not None:
        if min(sigma) <= 0.0:
            raise click.UsageError("--sigma: a sigma is greater than zero")
        return Precision(sigma=sigma)
    if image is None:
        return Precision()
    if stations is None:
        raise click.UsageError("--image-sigma needs --cameras")
    return Precision(cameras=stations, image_sigma=image * 1e-3 / focal)
