"""A hand-made solution of a ten-photo strip at Grand Cayman, in each coordinate system, from seeded numbers.

Nothing here is adjusted: positions, residuals and sigmas are drawn so that they look like those of a real job. What
the statistics and the reports must make of them is computed independently in the tests.
"""

import numpy as np

from musatpy import model
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.units import ARC_SECOND, DEGREE

PHOTOS = tuple(str(frame) for frame in range(837, 847))
BATHYMETRIC = ("1047", "1056", "1042", "1043", "1044", "1046", "1049", "1050", "1051", "1052", "1053", "1057")
ORIGIN = np.array([19.35 * DEGREE, -81.33 * DEGREE, 0.0])
BASE, HEIGHT = 1800.0, 3000.0
NAN = float("nan")


class _Strip:
    """The drawn numbers of the strip in a local frame at ORIGIN (metres east, north, up)."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        n = len(PHOTOS)
        self.stations = np.column_stack([-BASE * (np.arange(n) - n / 2), 400.0 * np.arange(n), np.full(n, HEIGHT)])
        self.stations += rng.normal(0.0, 20.0, (n, 3))
        self.attitudes = np.column_stack([rng.normal(0.0, 0.02, (n, 2)), np.full(n, np.pi - 0.2)])
        self.attitudes[:, 2] += rng.normal(0.0, 0.01, n)
        extra = [str(name) for name in range(1101, 1101 + 98 - len(BATHYMETRIC))]
        self.ids = np.array([*BATHYMETRIC, *extra])
        along = np.concatenate([rng.uniform(4.2, 7.2, len(BATHYMETRIC)), np.linspace(0.1, n - 1.1, len(extra))])
        self.along = along
        self.points = np.column_stack(
            [-BASE * (along - n / 2), 400.0 * along + rng.uniform(-1800, 1800, len(along)), np.zeros(len(along))]
        )
        self.points[:, 2] = rng.uniform(0.0, 18.0, len(along))
        self.points[: len(BATHYMETRIC), 2] = -rng.uniform(1.0, 12.0, len(BATHYMETRIC))
        self.rng = rng

    def rays(self) -> np.ndarray:
        """Return the (photo, point) links of all rays, in the order of the photos."""
        frames = np.arange(len(PHOTOS))
        seen = np.abs(self.along[None, :] - frames[:, None]) <= 1.05
        return np.argwhere(seen)


def sample_block(
    system: model.CoordinateSystem = model.CoordinateSystem.GEOGRAPHIC,
    refraction: model.Refraction = model.Refraction.WATPT,
) -> model.Block:
    """Return the block: 10 photos, 98 points, 7 horizontal, 35 vertical and 3 check points."""
    return _block(_Strip(306), system, refraction)


def sample_solution(
    system: model.CoordinateSystem = model.CoordinateSystem.GEOGRAPHIC,
    refraction: model.Refraction = model.Refraction.WATPT,
    *,
    converged: bool = True,
) -> model.Solution:
    """Return a solution of `sample_block`; point 1101 is not determined, point 1047 kept out and intersected."""
    strip = _Strip(306)
    block = _block(strip, system, refraction)
    rng = strip.rng
    n, p = len(PHOTOS), len(strip.ids)
    adjusted = strip.points + rng.normal(0.0, [0.5, 0.5, 2.0], (p, 3))
    position = _in_system(adjusted, system)
    status = np.full(p, int(model.PointStatus.TRIANGULATED))
    status[0], status[12] = model.PointStatus.INTERSECTED, model.PointStatus.NOT_DETERMINED
    position[12] = np.nan
    covariance = _covariances(rng, np.tile([0.1, 0.1, 0.3], (p, 1)))
    covariance[12] = np.nan
    return model.Solution(
        block=block,
        converged=converged,
        reason="" if converged else "photo 843 still moves by 0.412 m and 12.3 arc seconds after 20 iterations",
        warnings=("point 1101: a single ray and no control",),
        iterations=_iterations(),
        passes=_passes(refraction),
        sigma0=1.0375,
        degrees_of_freedom=271,
        sum_of_squares=271 * 1.0375**2,
        observations={"plate coordinates": 2 * len(block.plates.photo), "station positions": 30, "control": 49},
        unknowns={"stations": 6 * n, "ground coordinates": 3 * p},
        stations=model.AdjustedStations(
            position=_in_system(strip.stations + rng.normal(0.0, [8.0, 12.0, 20.0], (n, 3)), system),
            attitude=strip.attitudes + rng.normal(0.0, [600.0, 900.0, 1.0], (n, 3)) * ARC_SECOND,
            covariance=_covariances(rng, np.tile([0.3, 0.3, 0.2, 2e-5, 2e-5, 1e-5], (n, 1))),
        ),
        points=model.GroundPoints(
            position=position,
            covariance=covariance,
            status=status,
            rays=np.bincount(block.plates.point, minlength=p),
            reasons={0: "kept out by its plate cards", 12: "a single ray and no control"},
        ),
        plates=(plates := _residuals(rng, block, status)),
        bathymetric=_bathymetric(adjusted, system),
        levels=np.array([0.113]),
        level_sigmas=np.array([0.071]),
        measured={
            model.ObservationKind.AIR_BASE: np.array([1843.2214]),
            model.ObservationKind.DISTANCE: np.array([612.4123]),
            model.ObservationKind.HEIGHT_DIFFERENCE: np.array([-3.2041]),
        },
        water=_water(block),
        pairs=model.StationPairs(photo=np.array([[0, 1], [1, 2]]), covariance=rng.normal(0.0, 1e-3, (2, 6, 6))),
        level_pairs=model.LevelPairs(
            photo=np.array([[0, 0], [0, 1]]),
            of_first=rng.normal(0.0, 1e-3, (2, 6)),
            of_second=rng.normal(0.0, 1e-3, (2, 6)),
            level=np.array([0.02, 0.01]),
        ),
        water_precision=model.WaterPrecision(
            names=("water level",),
            covariance=np.array([[0.01]]),
            stations=rng.normal(0.0, 1e-3, (n, 6, 1)),
            levels=np.empty((0, 1)),
        ),
        observed=_observed(rng, block, plates),
        dependence=_dependence(rng, n),
        findings=(
            model.Finding(
                kind=model.CauseKind.IMAGE,
                photo="1",
                point="101",
                test=5.5,
                size=(61.0, np.nan),
                action=model.Action.KEPT_OUT,
                note="it lies on point 102",
            ),
        ),
        causes=(
            model.Cause(
                kind=model.CauseKind.HORIZONTAL,
                cards=("CTG",),
                points=("101",),
                component="position",
                size=(10.1, -0.2),
                sigma=(0.15, 0.16),
                unit="m",
                parameters=2,
                drop=4378.8,
                test=44.8,
                advice="read the control card again",
            ),
        ),
    )


def _water(block: model.Block) -> model.AdjustedWater:
    return model.AdjustedWater(
        tide=block.photos.tide + 0.12,
        correction=[0.12],
        correction_ids=[""],
        correction_sigma=[0.05],
        tilt=[1.2e-5, -3e-6],
        tilt_sigma=[4e-6, 5e-6],
        index=1.3412,
        index_sigma=0.0008,
    )


def _observed(rng: np.random.Generator, block: model.Block, plates: model.PlateResiduals) -> model.Observations:
    """Return a row of every kind, and forty plate coordinates."""
    images = np.flatnonzero(plates.triangulated)[:20]
    kind = np.array([0] * 40 + list(range(1, 11)))
    row = np.concatenate([np.repeat(images, 2), np.zeros(10, dtype=int)])
    component = np.concatenate([np.tile([0, 1], 20), np.zeros(10, dtype=int)])
    sigma = np.where(kind == 0, 0.01, 0.2)
    sigma[:40] = block.plate_sigmas[images].ravel()
    influence = rng.normal(0.0, 0.1, (50, 3))
    residual = rng.normal(0.0, 0.7, 50) * sigma
    residual[:40] = plates.residual[images].ravel()
    influence[(kind >= 6) & (kind <= 8)] = NAN
    return model.Observations(
        kind=kind,
        row=row,
        component=component,
        residual=residual,
        sigma=sigma,
        redundancy=np.concatenate([[0.0], rng.uniform(0.1, 0.9, 49)]),
        influence=influence,
    )


def _dependence(rng: np.random.Generator, n: int) -> model.Dependence:
    return model.Dependence(
        station_inflation=rng.uniform(5.0, 900.0, (n, 6)),
        names=["level of group SHORE", "water level"],
        sigma=[0.071, 0.05],
        inflation=[7.0, 12.5],
        first=["photo 837 north"],
        second=["photo 837 X-tilt"],
        correlation=[-0.9731],
    )


def _block(strip: _Strip, system: model.CoordinateSystem, refraction: model.Refraction) -> model.Block:
    n = len(PHOTOS)
    photo, point = strip.rays().T
    m = len(photo)
    rng = np.random.default_rng(11)
    kept = np.ones(m, dtype=bool)
    kept[point == 0] = False
    plate_sigma = np.full((m, 2), NAN)
    plate_sigma[::50] = 0.012
    return model.Block(
        titles=("GRAND CAYMAN STRIP, FRAMES 837-846", "HAND-MADE NUMBERS FOR THE TESTS OF THE LISTING"),
        options=model.Options(system=system, refraction=refraction),
        ellipsoid=None if system is model.CoordinateSystem.LOCAL else model.EllipsoidSpec(name="clrk66"),
        water=model.Water(index=1.34, sigma=0.001),
        cameras=model.Cameras(
            ids=["RC10"], focal_length=[152.67], principal_point=[[0.004, -0.011]], format_size=[[230.0, 230.0]]
        ),
        distortion=model.Distortion(
            camera=[0, 0], kind=["RADL", "TABL"], values=[[1.2e-5, -3e-9, 0.0], [70.0, 0.004, NAN]]
        ),
        fiducials=model.Fiducials(
            camera=[0, 0], ids=["A", "B"], xy=[[106.0, 106.0], [-106.0, 106.0]], sigma=[[0.002, 0.002], [NAN, NAN]]
        ),
        photos=model.Photos(
            ids=PHOTOS,
            camera=np.zeros(n, dtype=int),
            position=_in_system(strip.stations, system),
            position_sigma=np.where(np.arange(n)[:, None] < 8, [25.0, 25.0, 40.0], NAN),
            attitude=strip.attitudes,
            attitude_sigma=np.full((n, 3), NAN),
            tide=np.where(np.arange(n) < 9, 0.4 - 0.05 * np.arange(n), NAN),
            tide_sigma=np.full(n, 0.05),
            time=np.where(np.arange(n) < 9, 12.5 * np.arange(n), NAN),
        ),
        fiducial_measurements=model.FiducialMeasurements(
            photo=[0, 0], ids=["A", "B"], xy=[[106.01, 105.99], [-105.98, 106.0]], sigma=np.full((2, 2), NAN)
        ),
        points=model.Points(ids=strip.ids, bathymetric=np.arange(len(strip.ids)) < len(BATHYMETRIC)),
        plates=model.PlateMeasurements(
            photo=photo, point=point, xy=rng.uniform(-105.0, 105.0, (m, 2)), sigma=plate_sigma, triangulated=kept
        ),
        control=_control(strip, system),
        equal_elevations=model.EqualElevations(ids=["SHORE"], sigma=[0.2], group=[0, 0, 0], point=[60, 61, 62]),
        air_bases=model.AirBases(photo=[[0, 1]], length=[1843.0], sigma=[0.5]),
        distances=model.Distances(point=[[60, 61]], length=[612.4], sigma=[0.02]),
        height_differences=model.HeightDifferences(point=[[61, 62]], difference=[-3.2], sigma=[0.005]),
        comparator=model.ComparatorSpec(rotation=90.0 * DEGREE),
        lenses=model.Lenses(camera=[0], centre=[[0.012, -0.004]], k0=[-2.4e-5], zero_radius=[10.0]),
        mark_distances=model.MarkDistances(
            camera=[0], marks=[["A", "B"]], distance=[212.0], sigma=[0.003], axis=["X"]
        ),
        reseau=model.ReseauCrosses(camera=[0], ids=["A01"], row=[1], column=[3], xy=[[-100.0, 100.0]]),
        cross_measurements=model.CrossMeasurements(photo=[0], ids=["A01"], xy=[[-99.987, 100.012]]),
        waves=_waves(),
        wave_origin=model.WaveOrigin(position=tuple(_in_system(strip.stations[:1], system)[0].tolist())),
    )


def _waves() -> model.Waves:
    return model.Waves(
        ids=["SW", "CHOP"],
        shape=["STOK", ""],
        period=[10.0, NAN],
        depth=[12.0, NAN],
        length=[NAN, 24.7],
        speed=[NAN, 6.17],
        height=[0.98, 0.29],
        azimuth=np.array([60.0, -20.0]) * DEGREE,
        crest=[12.5, -4.0],
        height_sigma=[0.1, NAN],
        length_sigma=[5.0, NAN],
        azimuth_sigma=[NAN, NAN],
        crest_sigma=[20.0, NAN],
    )


def _control(strip: _Strip, system: model.CoordinateSystem) -> model.Control:
    rows = [*range(13, 20), *range(30, 64), 10, 70, 71, 72, 12]
    kinds = (
        [model.ControlKind.HORIZONTAL] * 7
        + [model.ControlKind.VERTICAL] * 35
        + [model.ControlKind.CHECK] * 3
        + [model.ControlKind.FULL]
    )
    position = _in_system(strip.points[rows], system)
    if system is not model.CoordinateSystem.GEOCENTRIC:
        position[7:42, :2] = NAN
        position[:7, 2] = NAN
    sigma = np.tile([1.0, 1.0, 3.0], (len(rows), 1))
    sigma[42:45] = NAN
    fixed = np.zeros(len(rows), dtype=bool)
    fixed[0] = True
    return model.Control(point=rows, kind=kinds, fixed=fixed, position=position, sigma=sigma)


def _in_system(enu: np.ndarray, system: model.CoordinateSystem) -> np.ndarray:
    """Return positions (n, 3) in a system, from metres east, north, up of ORIGIN."""
    if system is model.CoordinateSystem.LOCAL:
        return enu.copy()
    ellipsoid = Ellipsoid("clrk66")
    xyz = ellipsoid.geocentric(ORIGIN) + enu @ ellipsoid.frame(ORIGIN)
    return xyz if system is model.CoordinateSystem.GEOCENTRIC else ellipsoid.geographic(xyz)


def _covariances(rng: np.random.Generator, sigmas: np.ndarray) -> np.ndarray:
    size = sigmas.shape[1]
    correlation = np.full((size, size), 0.2) + 0.8 * np.eye(size)
    scaled = sigmas * rng.uniform(0.7, 1.4, sigmas.shape)
    return scaled[:, :, None] * correlation * scaled[:, None, :]


def _residuals(rng: np.random.Generator, block: model.Block, status: np.ndarray) -> model.PlateResiduals:
    m = len(block.plates.photo)
    residual = rng.normal(0.0, [0.006, 0.010], (m, 2))
    residual[~block.plates.triangulated] = rng.normal(0.0, [0.01, 0.1], ((~block.plates.triangulated).sum(), 2))
    residual[status[block.plates.point] == model.PointStatus.NOT_DETERMINED] = np.nan
    submerged = block.points.bathymetric[block.plates.point]
    correction = np.where(submerged[:, None], rng.normal(0.0, 0.05, (m, 2)), 0.0)
    taken = block.plates.triangulated & (status[block.plates.point] == model.PointStatus.TRIANGULATED)
    return model.PlateResiduals(residual=residual, triangulated=taken, correction=correction)


def _bathymetric(adjusted: np.ndarray, system: model.CoordinateSystem) -> model.BathymetricPoints:
    s = len(BATHYMETRIC)
    depth = -adjusted[:s, 2] + 0.2
    apparent, predicted = adjusted[:s].copy(), adjusted[:s].copy()
    apparent[:, 2] = 0.2 - depth / 1.37
    predicted[:, 2] = 0.2 - depth / 1.37 * 1.36
    apparent_depth = depth / 1.37
    return model.BathymetricPoints(
        point=np.arange(s),
        apparent=_in_system(apparent, system),
        predicted=_in_system(predicted, system),
        water_level=np.full(s, 0.2),
        incidence=np.full(s, 0.3),
        apparent_depth=apparent_depth,
        predicted_depth=1.36 * apparent_depth,
        depth=depth,
        depth_sigma=np.full(s, 0.31),
    )


def _iterations() -> tuple[model.Iteration, ...]:
    def iteration(outer: int, number: int, seconds: float, metres: float, squares: float) -> model.Iteration:
        return model.Iteration(
            outer_pass=outer,
            number=number,
            rotation=seconds * ARC_SECOND,
            rotation_photo=4,
            translation=metres,
            translation_photo=9,
            sum_of_squares=squares,
            damping=0.0 if number > 1 else 1e-3,
        )

    return (
        iteration(0, 1, 1488.5, 66.72, 4.2e6),
        iteration(0, 2, 12.3, 0.81, 512.25),
        iteration(0, 3, 0.002, 1e-4, 505.125),
        iteration(1, 1, 31.5, 0.4, 300.5),
        iteration(1, 2, 1e-7, 1e-9, 291.7),
    )


def _passes(refraction: model.Refraction) -> tuple[model.WaterPass, ...]:
    if refraction not in (model.Refraction.WATPT, model.Refraction.LEGACY):
        return ()
    return (
        model.WaterPass(number=1, movement=4.512, point=3, rms_movement=2.11, rms_residual=0.0071),
        model.WaterPass(number=2, movement=0.0004, point=5, rms_movement=0.0002, rms_residual=0.0069),
    )
