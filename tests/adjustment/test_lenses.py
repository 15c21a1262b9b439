"""Unknown lenses: partials, a published calibration, errors against sigmas, what is not determined."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import musatpy
from altered import altered, put
from blocks import converged, simulation
from musatpy.adjustment import sightings
from musatpy.adjustment.job import prepared
from musatpy.errors import AdjustmentError
from musatpy.model import (
    LENS_PARAMETERS,
    Block,
    CauseKind,
    CauseSearch,
    DistortionSide,
    Grade,
    Lenses,
    LensUnknowns,
    ObservationKind,
    Polynomials,
    ReductionOptions,
)

CALIBRATION = Path(__file__).parents[3] / "shared" / "cases" / "camcal.json"
TRUE = {
    "F": 0.08,
    "XP": 0.02,
    "YP": -0.03,
    "K1": -3e-8,
    "K2": 2e-12,
    "P1": 4e-7,
    "P2": -3e-7,
    "B1": 2e-5,
    "B2": -3e-5,
}
LENS = ObservationKind.LENS
SIDES = tuple(DistortionSide)


def unknowns(block: Block, *names: str, sigma: float = np.nan) -> Block:
    """The block with parameters of its first camera unknown."""
    count = len(names)
    table = LensUnknowns(
        camera=np.zeros(count, dtype=int),
        parameter=np.array(names),
        value=np.full(count, np.nan),
        sigma=np.full(count, sigma),
    )
    return replace(block, lens_unknowns=table)


def displaced(ideal: np.ndarray, side: DistortionSide, of: dict[str, float]) -> np.ndarray:
    """Where ideal places (k, 2) about the principal point are measured, by formulas of the tests alone."""

    def bent(at: np.ndarray) -> np.ndarray:
        x, y = at.T
        r2 = x**2 + y**2
        radial = of["K1"] * r2 + of["K2"] * r2**2 + of["K3"] * r2**3
        dx = x * radial + of["P1"] * (r2 + 2 * x**2) + 2 * of["P2"] * x * y
        dy = y * radial + of["P2"] * (r2 + 2 * y**2) + 2 * of["P1"] * x * y
        return np.column_stack([dx, dy])

    affine = np.array([[1.0 + of["B1"], of["B2"]], [0.0, 1.0]])
    if side is DistortionSide.IDEAL:
        return (ideal + bent(ideal)) @ affine.T
    place = ideal
    for _ in range(30):
        place = ideal + bent(place)
    return place @ np.linalg.inv(affine).T


def through_lens(block: Block, side: DistortionSide, true: dict[str, float]) -> Block:
    """The block with its images, which are ideal, as a lens makes them."""
    camera, of = block.cameras, {name: true.get(name, 0.0) for name in LENS_PARAMETERS}
    ideal = (block.plates.xy - camera.principal_point[0]) * (1.0 + of["F"] / camera.focal_length[0])
    xy = displaced(ideal, side, of) + camera.principal_point[0] + [of["XP"], of["YP"]]
    return replace(block, plates=replace(block.plates, xy=xy), reduction=ReductionOptions(side=side))


def balanced(block: Block, radius: float) -> Block:
    """The block with a radial distortion of its camera that is zero at a radius."""
    nothing = np.array([np.nan])
    lens = Lenses(camera=np.array([0]), centre=np.full((1, 2), np.nan), k0=nothing, zero_radius=np.array([radius]))
    return replace(block, lenses=lens)


def drone(seed: int, noise: float = 10.0) -> Block:
    """Two strips flown to and fro, half of the points under water, stations observed; errors by the noise in um."""
    wrong = noise / 10.0
    return simulation(
        seed,
        terrain={"level": 60.0, "relief": 40.0, "wavelength": 900.0},
        water={},
        shoal=[{"share": 0.5, "depth": [2.0, 15.0]}],
        measurement={"noise": noise},
        flight={"photos": 4, "strips": 2, "height": 1200.0, "reverse_alternate": True, "attitude_scatter": 4.0},
        points={"extra": [{"number": 40}]},
        control=[{"kind": "full", "number": 5, "sigma": 0.05, "error": 0.05 * wrong}],
        stations={"position_error": 0.1 * wrong, "attitude_error": 0.3, "position_sigma": 0.1},
        options={"program": "IIIA", "refraction": "RIGOROUS"},
    ).block


@lru_cache
def first(seed: int) -> Block:
    return drone(seed)


@pytest.mark.parametrize("polynomials", Polynomials)
@pytest.mark.parametrize("side", SIDES)
def test_partials_are_those_of_differences(side: DistortionSide, polynomials: Polynomials) -> None:
    """Central differences of images in air and through the water: relative 1e-6 of the largest partial."""
    block = through_lens(first(1), side, TRUE)
    block = balanced(replace(block, reduction=ReductionOptions(side=side, polynomials=polynomials)), 60.0)
    job, state = prepared(unknowns(block, *LENS_PARAMETERS), None)
    network = job.network
    wet = np.asarray(job.bathymetric[network.point])
    network = network.with_plates(network.xy, wet)
    lenses = state.parameters[LENS] + np.array([TRUE.get(name, 1e-17) for name in LENS_PARAMETERS])
    state = replace(state, parameters={LENS: lenses})
    rays = np.arange(len(network.photo))[:: len(network.photo) // 60]
    assert wet[rays].any() and not wet[rays].all()
    ground = state.ground[network.point[rays]]
    images = sightings.images(network, state, rays, ground)
    assert network.lenses is not None and images.by_lens is not None
    for column, effect in enumerate(network.lenses.effect):
        size = np.zeros_like(lenses)
        size[column] = 1e-3 / effect
        ends = [
            sightings.image_coordinates(network, replace(state, parameters={LENS: lenses + s * size}), rays, ground)
            for s in (1, -1)
        ]
        expected = (ends[0] - ends[1]) / (2.0 * size[column])
        np.testing.assert_allclose(images.by_lens[..., column], expected, atol=1e-6 * np.abs(expected).max())
    for axis in range(3):  # what follows the lens: the ground point
        step = np.zeros(3)
        step[axis] = 0.05
        ends = [sightings.image_coordinates(network, state, rays, ground + s * step) for s in (1, -1)]
        expected = (ends[0] - ends[1]) / 0.1
        np.testing.assert_allclose(images.by_ground[..., axis], expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("side", SIDES)
def test_a_lens_is_found_from_images_without_error(side: DistortionSide) -> None:
    """Coordinates that are rounded to 1 nm say each parameter to a hundredth of its sigma."""
    solution = converged(unknowns(through_lens(drone(2, noise=0.0), side, TRUE), *TRUE))
    assert solution.parameters is not None
    change = solution.parameters.value - solution.parameters.given
    true = np.array([TRUE[name] for name in solution.parameters.parameter.tolist()])
    np.testing.assert_array_less(np.abs(change - true), 0.01 * solution.parameters.spread / solution.sigma0)


def test_a_radius_of_zero_distortion_is_another_focal_length_of_the_same_lens() -> None:
    """With s = K1 R^2 + K2 R^4 of the balanced lens F = (1 - s) F_R, K1 = K1_R / (1 - s)^3; sigmas likewise."""
    names, R = ("F", "K1", "K2"), 80.0
    block = unknowns(through_lens(first(2), DistortionSide.IDEAL, TRUE), *names)
    plain, other = converged(block), converged(balanced(block, R))
    assert other.sigma0 == pytest.approx(plain.sigma0, rel=1e-9)
    assert plain.parameters is not None and other.parameters is not None
    (F, K1, _), (F_R, K1_R, K2_R) = plain.parameters.value, other.parameters.value
    s = K1_R * R**2 + K2_R * R**4
    assert abs(s) > 1e-5
    by_other = np.array([1.0 - s, -F_R * R**2, -F_R * R**4])
    sigma = np.sqrt(by_other @ other.parameters.covariance @ by_other)
    assert plain.parameters.spread[0] == pytest.approx(sigma, rel=1e-4)  # of second order
    assert other.parameters.spread[0] != pytest.approx(sigma, rel=1e-2)
    assert F == pytest.approx((1.0 - s) * F_R, abs=1e-4 * sigma)
    assert K1 == pytest.approx(K1_R / (1.0 - s) ** 3, abs=1e-4 * plain.parameters.spread[1])


@pytest.mark.slow
def test_the_published_calibration_of_21_photographs() -> None:
    """DBAT 0.9.2, `camcal`: 423 unknowns, nothing given but 4 control points; to the printed digits."""
    if not CALIBRATION.exists():
        pytest.skip("the calibration stands beside the project")
    case = json.loads(CALIBRATION.read_text(encoding="utf-8"))
    printed, pixel = case["expected"], 5.43764 / 1704.0  # mm
    builder = musatpy.BlockBuilder(
        "CALIBRATION", program="IIIA", system="LOCL", refraction="NONE", initial="COMPUTE",
        plate_sigma=case["mark_sigma_px"] * pixel,
    )  # fmt: skip
    half = np.array(case["format_mm"]) / 2.0
    builder.add_camera("C", 7.3, principal_point=(half[0], -half[1]))
    marks = np.array(case["mark_id_image_px_py"])
    for photo in printed["stations"]:
        builder.add_photo(photo, "C")
        seen = marks[marks[:, 1] == float(photo)]
        builder.add_images(photo, [f"{mark:.0f}" for mark in seen[:, 0]], seen[:, 2:] * [pixel, -pixel])
    for point, *position in case["control_id_XYZ_m"]:
        builder.add_control(f"{point:.0f}", position, fixed=True)
    names = {"c_mm": "F", "px_mm": "XP", "py_mm": "YP", "aspect": "B1"} | {
        n: n for n in ("K1", "K2", "K3", "P1", "P2")
    }
    block = replace(
        unknowns(builder.build(), *names.values()), reduction=ReductionOptions(polynomials=Polynomials.CORRECTION)
    )
    solution = musatpy.adjust(block, causes=CauseSearch.NONE)
    assert solution.converged and solution.parameters is not None
    assert sum(solution.unknowns.values()) == printed["unknowns"]
    assert solution.degrees_of_freedom == printed["redundancy"]
    assert solution.sigma0 == pytest.approx(printed["sigma0"], abs=0.5e-4)
    assert np.sqrt(solution.sum_of_squares) == pytest.approx(printed["sqrt_vtpv"], abs=0.5e-3)
    lenses = {name: row for row, name in enumerate(solution.parameters.parameter.tolist())}
    for printed_name, name in names.items():
        value, sigma = printed["camera"][printed_name]
        sign = -1.0 if name == "YP" else 1.0  # the plate has its y upwards
        unit = 10.0 ** (
            np.floor(np.log10(abs(value))) - 5
        )  # of the last of six printed digits: P1 lies between two
        assert sign * solution.parameters.value[lenses[name]] == pytest.approx(value, abs=0.61 * unit), name
        assert solution.parameters.sigma[lenses[name]] == pytest.approx(sigma, rel=0.01), name
    ids = solution.block.photos.ids.tolist()
    for photo, station in printed["stations"].items():
        row = ids.index(photo)
        np.testing.assert_allclose(solution.stations.position[row], station["XYZ_m"], atol=0.6e-6)
        turn = np.degrees(solution.stations.attitude[row]) - station["omega_phi_kappa_deg"]
        np.testing.assert_allclose((turn + 180.0) % 360.0 - 180.0, 0.0, atol=1e-6)


def test_a_narrow_prior_holds_a_parameter() -> None:
    """Sigmas of a millionth of the usual size: the adjustment without these unknowns, to 1e-4 of a sigma."""
    held, narrow = converged(first(3)), converged(unknowns(first(3), "F", "XP", "YP", sigma=1e-9))
    sigma = np.sqrt(np.einsum("nii->ni", held.stations.covariance))[:, :3]
    axes = np.abs(narrow.stations.position[:, 2] - held.stations.position[:, 2]) / sigma[:, 2]
    assert axes.max() < 1e-4
    assert narrow.parameters is not None and narrow.parameters.verdicts.tolist() == ["only by its prior"] * 3
    assert narrow.degrees_of_freedom == held.degrees_of_freedom


@pytest.mark.slow
def test_iia_holds_its_cameras_and_considers_their_sigmas() -> None:
    """As IIIA does with values held: stations and points to .2 sigma, which the weights of both differ by."""
    names = tuple(TRUE)
    block = unknowns(through_lens(first(1), DistortionSide.MEASURED, TRUE), *names, sigma=1e-12)
    values = [TRUE[name] + {"F": block.cameras.focal_length[0]}.get(name, 0.0) for name in names]
    block = replace(block, lens_unknowns=replace(block.lens_unknowns, value=np.array(values)))
    block = altered(block, photos={"attitude_sigma": np.full((block.photos.count, 3), np.nan)})
    held = converged(block, program="IIA")
    both = converged(block)
    sigma = np.sqrt(np.einsum("nii->ni", both.stations.covariance))[:, 2]
    assert np.abs(held.stations.position - both.stations.position)[:, 2].max() < 0.2 * sigma.max()
    rough = converged(
        replace(block, lens_unknowns=replace(block.lens_unknowns, sigma=np.full(len(names), 1e-12))), program="IIA"
    )
    vague = altered(block, lens_unknowns={"sigma": put([0], 0.5)})
    wide = converged(vague, program="IIA")
    assert (
        wide.considered is not None and wide.considered.names.tolist()[0] == "F of camera " + block.cameras.ids[0]
    )
    variance = np.einsum("nii->ni", wide.points.covariance) - np.einsum("nii->ni", rough.points.covariance)
    # half a millimetre of the focal length moves what it moves: by differences
    moved = [
        converged(altered(vague, lens_unknowns={"value": put([0], values[0] + s)}), program="IIA")
        for s in (0.05, -0.05)
    ]
    by_focal = (moved[0].points.position - moved[1].points.position)[:, 2] / 0.1
    np.testing.assert_allclose(np.sqrt(variance[:, 2]), np.abs(0.5 * by_focal), rtol=0.02, atol=1e-3)


@pytest.mark.slow
def test_what_nothing_determines_is_named() -> None:
    """Vertical photographs of one height without observed stations: focal length and heights are one."""
    block = simulation(
        7,
        terrain={"relief": 0.0},
        flight={"photos": 4, "height": 1000.0, "attitude_scatter": 0.0},
        stations={"position_error": 5.0, "attitude_error": 0.1},
        control=[{"kind": "full", "number": 4, "sigma": 0.05}],
        options={"program": "IIIA", "refraction": "NONE"},
    ).block
    try:
        solution = musatpy.adjust(unknowns(block, "F", "XP", "YP"))
    except AdjustmentError as error:
        assert "camera" in str(error)
        return
    verdict = musatpy.verdict(solution)
    assert verdict.grade is not Grade.ACCEPTED
    assert "of camera" in str(verdict), str(verdict)


def test_unknown_lenses_are_printed_and_recorded() -> None:
    solution = converged(unknowns(first(1), "F", "K1", sigma=0.1))
    text = musatpy.listing(solution)
    assert "Adjusted Parameters" in text and "only by its prior" in text
    assert solution.observed is not None and (solution.observed.kind == ObservationKind.LENS).sum() == 2


@pytest.mark.slow
def test_a_wrong_focal_length_is_the_cause_and_freed_is_found() -> None:
    """Half a millimetre with observed stations: named first, within a tenth; estimated, within three sigmas."""
    true = first(11)
    wrong = altered(true, cameras={"focal_length": true.cameras.focal_length + 0.5})
    cause = musatpy.adjust(wrong).causes[0]
    assert cause.kind is CauseKind.FOCAL_LENGTH and cause.size[0] == pytest.approx(0.5, abs=0.05)
    lenses = converged(unknowns(wrong, "F")).parameters
    assert lenses is not None and lenses.verdicts.tolist() == ["determined"]
    assert abs(lenses.value[0] - true.cameras.focal_length[0]) < 3.0 * lenses.sigma[0]


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
def test_errors_are_as_large_as_their_sigmas(side: DistortionSide) -> None:
    """Forty draws over the water: errors over sigmas, RMS within 3 of .06 (all) and .11 (each)."""
    ratios = []
    for seed in range(40):
        solution = converged(unknowns(through_lens(drone(1000 + seed), side, TRUE), *TRUE))
        table = solution.parameters
        assert table is not None
        true = np.array([TRUE[name] for name in table.parameter.tolist()])
        ratios.append((table.value - table.given - true) / table.spread * solution.sigma0)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert abs(np.sqrt(np.mean(np.square(ratios))) - 1.0) < 0.18
    np.testing.assert_array_less(np.abs(rms - 1.0), 0.33)
