"""The block of a model: its stations, lenses and images as `Block` has them, with what is known besides.

Photo axes are x right, y up, z backward: (x, y) = (pixel - middle) times the size of a pixel, y turned. A lens of
computer vision is then one of the side IDEAL, about its principal point, its coefficients by powers of millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import geographic
from musatpy.model import LENS_PARAMETERS, ControlKind, EllipsoidSpec
from musatpy.model.tables import finite_rows
from musatpy.reduction.pixel_lens import CorrectedLens, PixelLens
from musatpy.sfm.model import Model, ModelError

TURN = np.diag([1.0, -1.0, -1.0])  # from x right, y down, z forward
_STEEPEST = 75.0  # degrees off the axis, up to where K1 to K3 hold 5 px of a focal length to .13 px
_USUAL = ("F", "XP", "YP", "K1", "K2", "P1", "P2")  # that are estimated, whatever the file says


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """A similarity from the coordinates of a model to geocentric metres, X = s R x + t, or to local ones."""

    scale: float
    rotation: FloatArray  # (3, 3)
    shift: FloatArray  # (3,)
    ellipsoid: Ellipsoid | None  # None: local

    @property
    def ellipsoid_spec(self) -> EllipsoidSpec | None:
        """The ellipsoid as a block states it."""
        if self.ellipsoid is None:
            return None
        name = self.ellipsoid.definition.partition("+ellps=")[2]
        return EllipsoidSpec(name=name) if name else ellipsoid_numbers(self.ellipsoid)

    def positions(self, x: FloatArray) -> FloatArray:
        """Return positions (n, 3) as a block has them: latitude, longitude (rad), height, or local metres."""
        placed = self.scale * x @ self.rotation.T + self.shift
        return placed if self.ellipsoid is None else geographic(self.ellipsoid, placed)

    def axes(self, positions: FloatArray) -> FloatArray:
        """Return east, north, up (n, 3, 3) at positions (n, 3) of `positions`."""
        if self.ellipsoid is None:
            return np.broadcast_to(np.eye(3), (len(positions), 3, 3))
        return self.ellipsoid.frame(positions)

    def attitudes(self, rotation: FloatArray, positions: FloatArray) -> FloatArray:
        """Return the attitudes (n, 3) rad of photos with rotations (n, 3, 3) at positions (n, 3)."""
        M = TURN @ rotation @ self.rotation.T
        return attitude_from_matrix(M @ np.swapaxes(self.axes(positions), 1, 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Beside:
    """What is known besides a model of n photos and p points; NaN where something is not given."""

    position: FloatArray  # (n, 3) observed stations, or antennas, as `Placement.positions`
    position_sigma: FloatArray  # (n, 3) m
    tide: FloatArray  # (n,) m
    tide_sigma: FloatArray  # (n,) m
    tide_group: TextArray  # (n,)
    time: FloatArray  # (n,) s
    wet: BoolArray  # (p,)
    dry: BoolArray  # (p,) for certain
    lever_arm: tuple[float, ...] = ()  # m, along the axes of a photo to the antenna of a known height; empty: none
    control: TextArray = field(default_factory=lambda: np.zeros(0, dtype=np.str_))  # (k,) ids
    control_position: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    control_sigma: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    check: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (k,) it is compared only
    control_photo: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (c,) of its images
    control_of: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (c,) whose images these are
    control_pixel: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))  # (c, 2)

    @classmethod
    def nothing(cls, photos: int, points: int) -> Beside:
        """Return that nothing is known."""
        position, level = np.full((photos, 3), np.nan), np.full(photos, np.nan)
        return cls(
            position=position, position_sigma=position, tide=level, tide_sigma=level, time=level,
            tide_group=np.full(photos, "", dtype=np.str_),
            wet=np.zeros(points, dtype=bool), dry=np.zeros(points, dtype=bool),
        )  # fmt: skip


def plate_coordinates(lens: PixelLens, pixels: FloatArray, size: float) -> FloatArray:
    """Return plate coordinates (..., 2) mm of pixels (..., 2), of which one is `size` mm."""
    return (pixels - [0.5 * lens.width, 0.5 * lens.height]) * [size, -size]


def pixels_of(lens: PixelLens, xy: FloatArray, size: float) -> FloatArray:
    """Return the pixels (..., 2) of plate coordinates (..., 2) mm."""
    return xy / [size, -size] + [0.5 * lens.width, 0.5 * lens.height]


def is_reduced(lens: PixelLens) -> bool:
    """Return whether CAL cards cannot state a lens: images are made ideal by it, and corrections estimated."""
    return lens.fisheye or any(lens.d) or any(lens.k[3:])


def lens_parameters(lens: PixelLens, size: float) -> dict[str, float]:
    """Return the parameters of a lens as CAL cards have them, pixels of `size` mm. Raises `ValueError`.

    A fisheye lens, a denominator and a fourth radial coefficient have none.
    """
    if is_reduced(lens):
        raise ValueError("a fisheye lens, or one with more than three radial coefficients")
    (fx, fy), (cx, cy), (p1, p2) = lens.focal, lens.centre, lens.p
    f = fy * size
    k = (*lens.k, 0.0, 0.0, 0.0)
    values = (
        f, (cx - 0.5 * lens.width) * size, (0.5 * lens.height - cy) * size,
        k[0] / f**2, k[1] / f**4, k[2] / f**6, p2 / f, -p1 / f, fx / fy - 1.0, -lens.shear / fy,
    )  # fmt: skip
    return dict(zip(LENS_PARAMETERS, values, strict=True))


def lens_of(parameters: dict[str, float], lens: PixelLens, size: float) -> PixelLens:
    """Return a lens of `parameters` with the format of another one: the way back."""
    of = {name: parameters.get(name, 0.0) for name in LENS_PARAMETERS}
    f = of["F"]
    fy = f / size
    return PixelLens(
        width=lens.width,
        height=lens.height,
        focal=(fy * (1.0 + of["B1"]), fy),
        centre=(of["XP"] / size + 0.5 * lens.width, 0.5 * lens.height - of["YP"] / size),
        shear=-of["B2"] * fy,
        k=(of["K1"] * f**2, of["K2"] * f**4, of["K3"] * f**6),
        p=(-of["P2"] * f, of["P1"] * f),
    )


def corrected_lens(parameters: dict[str, float], lens: PixelLens, size: float) -> CorrectedLens:
    """Return a lens whose ideal images have a lens of `parameters` themselves."""
    f = lens.focal[1] * size
    plane = PixelLens(width=0, height=0, focal=(1.0, 1.0), centre=(0.0, 0.0))
    given = {field.name: getattr(lens, field.name) for field in fields(lens)}
    return CorrectedLens(**given, correction=lens_of({"F": f} | parameters, plane, f))


def block_of(
    model: Model,
    placement: Placement,
    beside: Beside,
    used: BoolArray,
    *,
    size: float,
    image_sigma: float,
    index: float,
    index_sigma: float | None,
    held: bool,
    title: str,
) -> Any:
    """Return the block of a model with those of its points that are `used` (p,).

    size: mm of a pixel; image_sigma: mm. With lenses `held` images are made ideal, else they are estimated anew.
    So are images of a lens that CAL cards cannot state, and corrections of these estimated. Raises `DeckError` with
    what is wrong between its parts, and `ModelError` for a lens without a plane of ideal images.
    """
    from musatpy.formats.builder import BlockBuilder  # which loads the cards

    options = {"program": "IIIA", "refraction": "RIGOROUS", "plate_sigma": image_sigma}
    options |= {"system": "LOCL"} if placement.ellipsoid is None else {"system": "GEOG"}
    options |= {"water_level": "GROUP"} if (beside.tide_sigma > 0.0).any() else {}
    build = BlockBuilder(title, ellipsoid=placement.ellipsoid_spec, **options)
    if beside.wet.any():
        build.water(index, sigma=index_sigma)
    names = [str(number + 1) for number in range(len(model.lenses))]
    _add_cameras(build, model, names, size, held)
    positions = placement.positions(model.centre)
    sigma = beside.position_sigma
    antennas = finite_rows(sigma) & bool(beside.lever_arm)
    if antennas.any():
        of = {"position": beside.position[antennas], "sigma": sigma[antennas]}
        build.add("antenna_positions", photo=model.photos[antennas], **of)
        for name in names:
            build.add("lever_arms", camera=name, offset=beside.lever_arm)
        sigma = np.where(antennas[:, None], np.nan, sigma)
    build.add(
        "stations",
        ids=model.photos,
        camera=np.array(names)[model.camera],
        position=np.where(np.isfinite(sigma), beside.position, positions),  # in plan both or none
        position_sigma=sigma,
    )
    build.add("attitudes", ids=model.photos, attitude=placement.attitudes(model.rotation, positions))
    tidal = np.isfinite(beside.tide)
    if tidal.any():
        build.add(
            "tides",
            ids=model.photos[tidal],
            **{name: getattr(beside, name)[tidal] for name in ("tide", "tide_sigma", "tide_group", "time")},
        )
    _add_images(build, model, beside, used, size, image_sigma, held)
    return build.build()


def _add_cameras(build: Any, model: Model, names: list[str], size: float, held: bool) -> None:
    """Add the cameras, and what is unknown of their lenses."""
    for number, (name, camera, lens) in enumerate(zip(names, model.cameras, model.lenses, strict=True)):
        f, reduced = lens.focal[1] * size, is_reduced(lens)
        x, y = plate_coordinates(lens, np.array(lens.centre), size).tolist()
        form = lens.width * size, lens.height * size
        if reduced:
            pixels = model.pixel[model.camera[model.photo] == number]
            if lens.fisheye and (steepest := float(np.degrees(lens.steepest(pixels)))) > _STEEPEST:
                message = (
                    f"camera {camera}: fisheye images reach {steepest:.0f} degrees off the axis, and the plane "
                    f"of ideal images holds none beyond {_STEEPEST:.0f}: undistort the photos before the model"
                )
                raise ModelError.of(message)
            extent = np.abs(ideal_coordinates(lens, pixels, size)).max(axis=0, initial=0.5 * min(form))
            form = float(2.0 * extent[0]), float(2.0 * extent[1])
        build.add_camera(
            name, f, principal_point=(0.0, 0.0) if held or reduced else (x, y), format_size=form,
        )  # fmt: skip
        if held:
            continue
        values = dict.fromkeys(LENS_PARAMETERS, 0.0) | {"F": f} if reduced else lens_parameters(lens, size)
        for parameter, value in values.items():
            if parameter in _USUAL or value or (reduced and parameter == "K3"):
                build.add("lens_unknowns", camera=name, parameter=parameter, value=value)
    if not held:
        build.add("reduction", plates="REFINED", side="IDEAL", polynomials="DIST")


def _add_images(
    build: Any, model: Model, beside: Beside, used: BoolArray, size: float, image_sigma: float, held: bool
) -> None:
    """Add the images of points and of control, and the control."""
    ids = tie_names(model.points, beside.control)
    rows = np.flatnonzero(used[model.point])
    point = model.point[rows]
    photo, pixel = (
        np.concatenate([model.photo[rows], beside.control_photo]),
        np.concatenate([model.pixel[rows], beside.control_pixel]),
    )
    xy, sigma = np.empty_like(pixel), np.full_like(pixel, np.nan)
    camera = model.camera[photo]
    for number, lens in enumerate(model.lenses):
        of = camera == number
        ideal = held or is_reduced(lens)
        xy[of] = ideal_coordinates(lens, pixel[of], size) if ideal else plate_coordinates(lens, pixel[of], size)
        if is_reduced(lens):
            sigma[of] = image_sigma * stretch(lens, pixel[of])
    none = np.zeros(len(beside.control_of), dtype=bool)
    build.add_images(
        model.photos[photo],
        np.concatenate([ids[point], beside.control[beside.control_of]]),
        xy,
        sigma=sigma,
        submerged=np.concatenate([beside.wet[point], none]),
        dry=np.concatenate([beside.dry[point], none]),
    )
    if len(beside.control):
        build.add(
            "control",
            point=beside.control,
            kind=np.where(beside.check, ControlKind.CHECK, ControlKind.FULL),
            position=beside.control_position,
            sigma=beside.control_sigma,
        )


def tie_names(points: TextArray, control: TextArray) -> TextArray:
    """Return names (p,) of the points of a model that no control point has: with T before all where one has."""
    return np.char.add("T", points) if np.isin(points, control).any() else points


def ideal_coordinates(lens: PixelLens, pixels: FloatArray, size: float) -> FloatArray:
    """Return ideal plate coordinates (..., 2) mm about a principal point of zero, NaN where the lens has none."""
    f = lens.principal_distance * size
    return lens.rays(pixels) * [f, -f]


def stretch(lens: PixelLens, pixels: FloatArray) -> FloatArray:
    """Return how many times larger than on the photo errors of pixels (..., 2) are among ideal coordinates."""
    by_pixel = np.linalg.inv(lens.partials(lens.rays(pixels)))
    return np.asarray(np.linalg.norm(by_pixel, axis=-1))


def ellipsoid_numbers(ellipsoid: Ellipsoid) -> EllipsoidSpec:
    """Return an ellipsoid that has no name by its two numbers."""
    words = dict(word.removeprefix("+").split("=") for word in ellipsoid.definition.split())
    flattening = float(words["rf"]) if "rf" in words else 0.0
    return EllipsoidSpec(semi_major_axis=float(words["a"]), inverse_flattening=flattening)
