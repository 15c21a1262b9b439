"""`musat depth`: depth factors over a stereo model; options of water, stations, model and places."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import LazyGroup, dpi_option, flag, option, options_of

if TYPE_CHECKING:
    from musatpy.depth.cameras import CameraStations
    from musatpy.depth.correction import Correction
    from musatpy.depth.views import DepthFactors, VerticalPair

_HIDDEN = {"correct": "musatpy.cli.correct:depth_command"}  # an old name of `musat correct`
_MOST_PLACES = 2000  # each way: four million make some hundred megabytes
_MOST_LEVELS = 1000  # lines of a table or a picture that someone still reads


class Finite(click.FloatRange):
    """A number within limits; infinite ones and NaN, which `float` reads too, are none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number of a text."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"'{value}' is not a finite number", param, ctx)
        return number

    def _describe_range(self) -> str:
        """Return what `--help` says of the limits: nothing where there are none, which click tells as None."""
        return super()._describe_range() if (self.min, self.max) != (None, None) else ""


NUMBER, POSITIVE = Finite(), Finite(min=0.0, min_open=True)


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """Numbers with commas between them, as many as said."""

    name = "numbers"

    def __init__(self, count: int = 0, *, positive: bool = False) -> None:
        self.count, self.positive = count, positive

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers of a text."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"'{value}' is not numbers with commas between them", param, ctx)
        if self.count and len(numbers) != self.count:
            self.fail(f"{self.count} numbers are needed, not {len(numbers)}", param, ctx)
        if not all(map(math.isfinite, numbers)):
            self.fail(f"'{value}' has a number that is not finite", param, ctx)
        if self.positive and min(numbers) <= 0.0:
            self.fail(f"'{value}' has a number that is not greater than zero", param, ctx)
        return numbers


class SigmasOfAxes(Numbers):
    """Sigmas of three coordinates, of which fewer may be said: by how many there are, which of them are whose."""

    name = "sigmas"

    def __init__(self, whose: Mapping[int, tuple[int, int, int]]) -> None:
        super().__init__(positive=True)
        self.whose = whose

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the three sigmas of a text."""
        sigmas = super().convert(value, param, ctx)
        if len(sigmas) not in self.whose:
            self.fail(f"{' or '.join(map(str, self.whose))} numbers are needed, not {len(sigmas)}", param, ctx)
        return tuple(sigmas[n] for n in self.whose[len(sigmas)])


index_options = options_of(
    option("--index", "Refractive index of water relative to air.", Finite(1.0, 2.0)),
    option("--liquid NAME", "Liquid that is not water; --index may be 1 to 2.", default=""),
    option("--temperature DEGC", "Temperature of the water; replaces --index.", NUMBER),
    option("--salinity PPT", "Salinity of the water, with --temperature.", NUMBER),
    option("--chlorinity PPT", "Chlorinity of the water; replaces --salinity.", NUMBER),
    option("--wavelength NM", "Wavelength of the light, with --temperature.", NUMBER),
    option("--formula", "Formula of the index by temperature.", click.Choice(["QUANFRY", "IAPWS"])),
)
camera_options = options_of(
    option("--level", "Height of the water if the stations have no tides.", NUMBER),
    option("--focal MM", "Focal length of all cameras.", POSITIVE),
    option(
        "--format W,H",
        "Width and height of the format of all cameras, mm.",
        Numbers(2, positive=True),
        name="frame",
    ),
    option(
        "--angle DEG",
        "A camera sees only what is within this angle of the vertical.",
        Finite(0.0, 90.0, min_open=True, max_open=True),
    ),
)
system_options = options_of(
    option(
        "--crs SYSTEM",
        "Coordinate system of the points: a code (EPSG:32620), PROJ string or WKT. Default: that of the "
        "file, else that of the run.",
    ),
    option("--geoid GRID", "Grid file of the geoid that the heights of the points refer to, with --crs."),
)
view_options = options_of(
    option("--height", "Height of a vertical pair above the water, in any unit.", POSITIVE),
    option("--base", "Base of the pair, in the same unit.", POSITIVE),
    option(
        "--cameras",
        "Stations (CSV or RUN.json); replaces --height and --base.",
        click.Path(path_type=Path),
        name="stations",
    ),
    flag("--exact", "Compute the pair by exact rays, not by the formula of the paper."),
    index_options,
    camera_options,
)
area_options = options_of(
    option("--width", "Width of the model across the base. Default: twice the base.", POSITIVE),
    option("--area X,Y,X,Y", "Corners of the area. Default: the model.", Numbers(4)),
    option("--grid NX,NY", "Number of places along x and y.", Numbers(2), shown="5,5"),
)
depths_option = option("--depths", "Apparent depths to list.", Numbers(), shown="0,10,25,50,100")


def index_by(given: dict[str, Any], cameras: CameraStations | None = None) -> float:
    """Return the index that the options say or that follows from them, else that of the run of the cameras."""
    from musatpy.formats.refractive_index import faults, index_of
    from musatpy.model import WaterConditions
    from musatpy.model.water import index_fault

    index, names = given["index"], ("temperature", "salinity", "chlorinity", "wavelength", "formula")
    stated = {name: given[name] for name in names if given[name] is not None}
    if index is not None:
        if stated:
            raise click.UsageError("--index and conditions of the water: one or the other, not both")
        if fault := index_fault(index, given["liquid"]):
            raise click.UsageError(f"--index: {fault}" + ("" if given["liquid"] else " by --liquid"))
        return float(index)
    if cameras is not None and cameras.index is not None and not stated:
        return cameras.index
    if not {"temperature", "wavelength"} <= stated.keys() or ("salinity" in stated) == ("chlorinity" in stated):
        needed = "--temperature, --wavelength and --salinity or --chlorinity"
        raise click.UsageError(f"the water is not known: --index is needed, or {needed}")
    water = WaterConditions(**stated)
    wrong = [f"--{name}: {message}" for name, message in faults(water)]
    if wrong:
        raise click.UsageError("; ".join(wrong))
    return index_of(water)


def limit_and_camera(given: dict[str, Any]) -> tuple[float | None, tuple[float, float, float] | None]:
    """Return the largest angle (rad), and focal length, width and height (mm) of all cameras, as options say."""
    from musatpy.units import DEGREE

    focal, frame, angle = given["focal"], given["frame"], given["angle"]
    if (focal is None) != (frame is None):
        raise click.UsageError("--focal and --format go together")
    return None if angle is None else angle * DEGREE, None if focal is None else (focal, *frame)


def cameras_by(path: Path, given: dict[str, Any]) -> CameraStations:
    """Return the cameras of a file, or of the record of a run, completed by options."""
    from musatpy.depth.cameras import RECORD, read_cameras, read_run

    limit, camera = limit_and_camera(given)
    if path.suffix.lower() == RECORD:
        if given["level"] is not None:
            raise click.UsageError("--level: the run has the tides of its photos")
        return read_run(path, camera=camera, limit=limit)
    return read_cameras(path, level=given["level"], camera=camera, limit=limit)


def check_step(step: float, factor: Any) -> None:
    """Refuse a step that makes too many levels of factors."""
    import numpy as np

    levels = (np.nanmax(factor) - np.nanmin(factor)) / step
    if levels > _MOST_LEVELS:
        raise click.UsageError(f"--step: {step:g} makes {levels:.0f} levels, more than {_MOST_LEVELS}")


class ModelView:
    """The pair or the stations of a command, and its places."""

    def __init__(self, given: dict[str, Any]) -> None:
        self.given = given
        self.model: Correction | None = None
        self.pair: VerticalPair | None = None
        height, base = given["height"], given["base"]
        if given["stations"] is not None:
            if height is not None or base is not None or given["exact"]:
                raise click.UsageError("--cameras replaces --height, --base and --exact")
            from musatpy.depth.views import model_of

            cameras = cameras_by(given["stations"], given)
            self.index = index_by(given, cameras)
            self.model = model_of(cameras, self.index)
            return
        self.index = index_by(given)
        if height is None or base is None:
            raise click.UsageError("--height and --base are needed, or --cameras")
        if any(given[name] is not None for name in ("level", "focal", "frame", "angle")):
            raise click.UsageError("--level, --focal, --format and --angle go with --cameras")
        from musatpy.depth.views import VerticalPair

        self.pair = VerticalPair(height=height, base=base, index=self.index)

    def heading(self) -> str:
        """Return what the factors are of."""
        if self.pair is None:
            assert self.model is not None
            system = self.model.points_in
            where = f"\nx, y: {system.text}" if system.ellipsoid else ""
            return f"{len(self.model.cameras.names)} stations, n = {self.index:.5f}, by rays{where}"
        how = "by rays" if self.given["exact"] else "by formula"
        return f"Height {self.pair.height:g}, base {self.pair.base:g}, n = {self.index:.5f}, {how}"

    def nadirs(self) -> Any:
        """Return where the stations are (k, 2)."""
        import numpy as np

        if self.pair is not None:
            return np.array([[0.0, 0.0], [self.pair.base, 0.0]])
        assert self.model is not None
        return self.model.nadirs

    def grid(self) -> tuple[Any, Any]:
        """Return x (nx,) and y (ny,) of the places."""
        import numpy as np

        counts = [int(number) for number in self.given["grid"]]
        if not all(2 <= count <= _MOST_PLACES for count in counts) or counts != list(self.given["grid"]):
            raise click.UsageError(f"--grid: a whole number of places, 2 to {_MOST_PLACES} each way, is needed")
        corners = self.given["area"]
        if corners is None:
            low, high = self.nadirs().min(axis=0), self.nadirs().max(axis=0)
            if self.pair is not None:
                half = (self.given["width"] or 2.0 * self.pair.base) / 2.0
                low, high = np.array([0.0, -half]), np.array([self.pair.base, half])
            corners = (*low, *high)
        if not (corners[0] < corners[2] and corners[1] < corners[3]):
            raise click.UsageError("an area is needed: --area with the lower left corner first")
        x, y = (np.linspace(corners[i], corners[i + 2], counts[i]) for i in (0, 1))
        return x, y

    def over_grid(self, depths: tuple[float, ...]) -> tuple[dict[str, Any], DepthFactors]:
        """Return the places of the grid, x fastest, and their factors."""
        import numpy as np

        x, y = (axis.reshape(-1) for axis in np.meshgrid(*self.grid()))
        return {"x": x, "y": y}, self._factors(x, y, depths)

    def _factors(self, x: Any, y: Any, depths: tuple[float, ...]) -> DepthFactors:
        import numpy as np

        from musatpy.depth.views import PairPlaces, factors

        if min(depths) < 0.0:
            raise click.UsageError("an apparent depth is not less than zero")
        if self.pair is None:
            assert self.model is not None
            return factors(self.model, x, y, np.array(depths))
        if self.given["exact"]:
            return self.pair.exact(x, y, np.array(depths))
        return self.pair.formula(PairPlaces.at(x, y, self.pair.base), np.array(depths))

    def listed(self, path: Path, depths: tuple[float, ...]) -> tuple[dict[str, Any], DepthFactors]:
        """Return the places of a file, and their factors."""
        import numpy as np

        from musatpy.depth.views import PairPlaces, read_places

        places = read_places(path)
        if "x" in places:
            return places, self._factors(places["x"], places["y"], depths)
        if self.pair is None or self.given["exact"]:
            raise click.UsageError("places by d1, d2, s, t are for the formula; rays need x, y")
        return places, self.pair.formula(PairPlaces(**places), np.array(depths))


# --- the commands ---


@click.group(name="depth", cls=LazyGroup, modules=_HIDDEN, short_help="Print and draw depth factors.")
def command() -> None:
    """Print and draw the depth factors of submerged points over a stereo model."""


@command.command(name="table")
@view_options
@area_options
@depths_option
@option("--at", "File of places, with columns x,y or d1,d2,s,t.", click.Path(path_type=Path), name="listed")
def table(listed: Path | None, depths: tuple[float, ...], **given: Any) -> None:
    """Print the depth factor at places of a model, for some apparent depths."""
    from musatpy.depth.views import factor_table

    view = ModelView(given)
    places, factors = view.listed(listed, depths) if listed else view.over_grid(depths)
    tell(view.heading())
    tell("\n".join(factor_table(places, factors)))


@command.command(name="errors")
@view_options
@area_options
@depths_option
@option("--normal", "Apparent depth whose factors are used for all depths.", NUMBER, shown=25.0)
@option("--value", "Factor to use for the whole model. Default: the median of all places.", POSITIVE)
@option("--step", "Step between the factors listed.", POSITIVE, shown=0.01)
def errors(depths: tuple[float, ...], normal: float, value: float | None, step: float, **given: Any) -> None:
    """Print the errors of two approximations: the factors of one depth for all depths, and one factor for the whole
    model."""
    import numpy as np

    from musatpy.depth.views import normalised_table, single_table

    view = ModelView(given)
    places, factors = view.over_grid(depths)
    _, at_normal = view.over_grid((normal,))
    factor = at_normal.factor[:, 0]
    if not np.isfinite(factor).any():
        raise click.UsageError("there is no factor anywhere: " + "; ".join(at_normal.reasons()))
    check_step(step, factor)
    x, y = (places[name] for name in ("x", "y"))
    tell(view.heading())
    tell(f"Factors of the apparent depth {normal:g} for all depths: largest departures")
    tell("\n".join(normalised_table(x, y, factors, factor)))
    value = float(np.nanmedian(factor)) if value is None else value
    tell(f"One factor {value:.4f} for the whole model, apparent depth {normal:g}")
    tell("\n".join(single_table(factor, value, normal, step)))
    missing = np.count_nonzero(np.isnan(factor))
    if missing:
        tell(f"{missing} of {len(factor)} places have no factor: {'; '.join(at_normal.reasons())}")
    for reason in factors.reasons():
        tell(f"-: {reason}")


@command.command(name="picture")
@click.argument("picture", type=click.Path(path_type=Path))
@view_options
@area_options
@option("--depth", "Apparent depth.", NUMBER, shown=25.0)
@option("--step", "Step between the contours.", POSITIVE, shown=0.01)
@dpi_option
def picture(picture: Path, depth: float, step: float, dpi: int, **given: Any) -> None:
    """Draw contours of the depth factor over a model into PICTURE (.png, .svg, .pdf)."""
    import numpy as np

    from musatpy.depth.views import contour_picture
    from musatpy.figures import ImageForm

    given["grid"] = tuple(max(61.0, number) for number in given["grid"])  # smooth lines
    view = ModelView(given)
    x, y = view.grid()
    _, factors = view.over_grid((depth,))
    factor = factors.factor.reshape(len(y), len(x))
    if not np.isfinite(factor).any():
        raise click.UsageError("there is no factor anywhere: " + "; ".join(factors.reasons()))
    check_step(step, factor)
    job = f"\n{given['stations'].stem}" if given["stations"] else ""
    title = f"Depth factor at an apparent depth of {depth:g}\n{view.heading()}{job}"
    contour_picture(picture, x, y, factor, view.nadirs(), title=title, step=step, form=ImageForm(dpi=dpi))
    tell(f"{name_of(picture)}: F {np.nanmin(factor):.4f} to {np.nanmax(factor):.4f}")
