"""Pairs of vertical photographs over flat and curved water, with images traced without what is tested."""

from typing import Any

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.joined_surfaces import DepthPoints, JoinedSurface
from musatpy.compilation.stereomodels import Stereomodel
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.compilation.true_points import Readings
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation
from musatpy.model.compilation import Compilation, StageReadings, StereomodelSpecs
from musatpy.model.tables import empty
from musatpy.refraction.flat import air_tangent
from musatpy.simulation.raytrace import trace
from musatpy.soundings.sounding_files import Soundings
from musatpy.surfaces.tin import Tin

SPHERE = model.EllipsoidSpec(semi_major_axis=6_371_000.0, inverse_flattening=0.0)
INDEX = 1.34
MODEL = "MDL 1        1        2                                          5.00"


def pair(
    height: float, base: float, tides: tuple[float, float] = (0.0, 0.0), *, sphere: bool = False
) -> AdjustedRun:
    """Return a run of two photographs, straight down, along X or along the equator, without errors."""
    position = np.array([[0.0, 0.0, height], [base, 0.0, height]])
    if sphere:
        radius = 6_371_000.0
        position = np.array([[0.0, east / (radius + height), height] for east in (0.0, base)])
    nothing = np.full((2, 3), np.nan)
    block = model.Block(
        titles=(),
        options=model.Options(
            program=model.Program.IIIA,
            system=model.CoordinateSystem.GEOGRAPHIC if sphere else model.CoordinateSystem.LOCAL,
            plate_sigma=0.005,
        ),
        ellipsoid=SPHERE if sphere else None,
        water=model.Water(index=INDEX),
        cameras=model.Cameras(
            ids=np.array(["C"]),
            focal_length=np.array([152.4]),
            principal_point=np.zeros((1, 2)),
            format_size=np.full((1, 2), 1e4),
        ),
        photos=model.Photos(
            ids=np.array(["1", "2"]),
            camera=np.zeros(2, dtype=int),
            position=position,
            position_sigma=nothing,
            attitude=np.zeros((2, 3)),
            attitude_sigma=nothing,
            tide=np.array(tides),
        ),
        points=empty(model.Points),
    )
    return AdjustedRun(
        block=block,
        given=position,
        covariance=np.zeros((2, 6, 6)),
        pairs=model.StationPairs(photo=np.array([[0, 1]]), covariance=np.zeros((1, 6, 6))),
        levels=None,
        water=None,
        position=np.zeros((0, 3)),
        point_covariance=np.zeros((0, 3, 3)),
        triangulated=np.zeros(0, dtype=bool),
        control=np.zeros(0, dtype=bool),
        unit_sigma=1.0,
    )


def flat_images(run: AdjustedRun, points: FloatArray) -> FloatArray:
    """Return the images (k, 2, 2) mm of points (k, 3) below flat water, by the tangent of their rays in air."""
    photos, f = run.block.photos, run.block.cameras.focal_length[0]
    gap = points[:, None] - photos.position
    D = np.linalg.norm(gap[..., :2], axis=-1)
    tangent = air_tangent(photos.position[:, 2] - photos.tide, photos.tide - points[:, None, 2], D, INDEX)
    return np.asarray(f * tangent[..., None] * gap[..., :2] / D[..., None])


def grid(X: tuple[float, float], Y: float, number: int = 15) -> FloatArray:
    """Return places (number squared, 2) between limits of X and -Y and Y."""
    places = np.meshgrid(np.linspace(*X, number), np.linspace(-Y, Y, number))
    return np.stack([part.ravel() for part in places], axis=1)


def at_depth(places: FloatArray, depth: float) -> FloatArray:
    """Return points (k, 3) at a depth below height 0."""
    return np.column_stack([places, np.full(len(places), -depth)])


def curved_images(stereo: Stereomodel, places: FloatArray, depth: float) -> tuple[FloatArray, FloatArray]:
    """Return working coordinates (k, 3) of points at a depth below a sphere of water, and their images (k, 2, 2).

    `places` (k, 2) are metres along the equator and towards north.
    """
    frame, photos = stereo.run.frame, stereo.run.block.photos
    radius = 6_371_000.0
    level = np.column_stack([places[:, 1] / radius, places[:, 0] / radius, np.full(len(places), -depth)])
    water = np.zeros(len(places))
    xy = np.empty((len(places), 2, 2))
    for photo, station in enumerate(frame.working(photos.position)):
        geocentric = np.broadcast_to(station + frame.origin, (len(places), 3))
        incidence = trace(geocentric, level, water, INDEX, (radius, 0.0)).incidence - frame.origin
        target = stereo.model(incidence)
        xy[:, photo] = stereo.images(np.stack([target, target], axis=1))[:, photo]
    return frame.working(level), xy


def readings_at(xy: FloatArray, submerged: bool = True, sigma: float = 0.005) -> Readings:
    """Return the readings of points (k, 2, 2), all of one kind."""
    return Readings.of(xy, np.full(len(xy), submerged), sigma)


def compiled_again(
    solution: model.Solution, xy: FloatArray, pointing: float, chosen: BoolArray | None = None
) -> tuple[Compiled, IntArray]:
    """Return points that photos 21 and 22 both show, read as xy (m, 2), and the rows of their left images."""
    block, rows = solution.block, [np.flatnonzero(solution.block.plates.photo == photo) for photo in (0, 1)]
    common, left, right = np.intersect1d(*(block.plates.point[of] for of in rows), return_indices=True)
    taken = np.ones(len(common), dtype=bool) if chosen is None else chosen[common]
    common, left, right = common[taken], rows[0][left[taken]], rows[1][right[taken]]
    deck = Compilation(
        titles=(),
        models=StereomodelSpecs(ids=["M"], left=["21"], right=["22"], pointing=[pointing]),
        stages=StageReadings(
            model=np.zeros(len(common), dtype=int), ids=block.points.ids[common],
            kind=np.full(len(common), "R"), submerged=block.points.bathymetric[common],
            xy=np.stack([xy[left], xy[right]], axis=1),
        ),
    )  # fmt: skip
    return compiled(of_solution(solution), deck), left


def stage_card(name: str, flags: str, stages: FloatArray) -> str:
    """Return the card of a reading in model 1, of four stage coordinates (mm)."""
    return f"STG 1        {name:<8} {flags}" + "".join(f"{value:11.6f}" for value in stages.ravel())


def deck_of_cards(*cards: str) -> Compilation:
    """Return the compilation deck of cards, which is read without a warning and written as it was read."""
    deck, warnings = read_compilation("\n".join([*cards, "END", ""]).encode())
    data = compilation_bytes(deck)
    assert not warnings and compilation_bytes(read_compilation(data)[0]) == data
    return deck


def surface_of(
    xyz: FloatArray, sigma: float = 0.0, water: float = 0.0, longest: float = np.inf, plan: Any = None
) -> JoinedSurface:
    """Return the bottom of points (k, 3), their third coordinate a depth, all of one sigma and below one water."""
    sigmas = np.full(len(xyz), sigma)
    points = DepthPoints(xy=xyz[:, :2], depth=xyz[:, 2], sigma=sigmas, water=np.full(len(xyz), water))
    return JoinedSurface(models=("M",), points=points, tin=Tin.of(xyz, sigmas, longest), plan=plan)


def soundings_at(
    place: FloatArray,
    depth: FloatArray,
    dates: list[str] | None = None,
    *,
    angular: bool = False,
    sigma: float = np.nan,
) -> Soundings:
    """Return soundings at places (k, 2), without dates where none are given."""
    return Soundings(
        names=np.arange(len(depth)).astype(np.str_),
        place=place,
        angular=angular,
        depth=depth,
        sigma=np.full(len(depth), sigma),
        date=np.array(dates or ["NaT"] * len(depth), dtype="datetime64[D]"),
    )
