"""Blocks -> files of other agencies -> blocks: what the files hold comes back, to the byte and the last decimal."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from altered import altered, put
from formats.agency_blocks import deck_of, random_job, with_marks
from formats.deck_edits import deck, drop, in_system
from musatpy.errors import DeckError
from musatpy.formats import families, parts
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.units import ARC_SECOND, GON

AGENCIES = families.agencies()
bingo, giant, jfk, patb = AGENCIES.values()
PLACES = {"giant": "job.cnt", "patb": "job.ori", "bingo": "itera.dat", "jfk": "job.jfk"}
SYSTEMS = list(CoordinateSystem)


def files_in(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.slow
@pytest.mark.parametrize("name", AGENCIES)
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), system=st.sampled_from(SYSTEMS))
def test_written_files_are_written_again_to_the_byte(tmp_path_factory, name, seed, system):
    agency, first, second = AGENCIES[name], tmp_path_factory.mktemp("a"), tmp_path_factory.mktemp("b")
    block = random_job(seed, system)
    block = with_marks(block, 4) if agency is jfk else block
    agency.dump_one(block, first / PLACES[name])
    given = deck_of(block, tmp_path_factory.mktemp("deck"))
    agency.dump_one(agency.load_one(first / PLACES[name], given), second / PLACES[name])
    ones, others = files_in(first), files_in(second)
    if (
        agency is patb
    ):  # a matrix of twelve decimals is a rotation, and so nine elements of three angles, to as many
        one, other = (np.array(files.pop("job.ori").split(), dtype=float) for files in (ones, others))
        assert np.all(np.abs(other - one) <= np.where(np.abs(one) > 1.5, 1e-5, 4e-12))
    assert ones == others
    assert len(files_in(first)) == len(agency.patterns)


# Half of the last decimal of positions (m), attitudes (rad) and plate coordinates (mm). Of packed longitudes the
# fourth decimal of a second is the last that fits, of packed kappas beyond 100 degrees the third, as it is of
# geocentric coordinates.
DECIMALS = {
    "giant": (0.5e-3, 0.5e-3 * ARC_SECOND, 0.5e-6),
    "patb": (0.5e-5, 1e-12, 0.5e-6),  # an angle of a matrix whose elements have errors up to 0.5e-12
    "bingo": (0.5e-4, 0.5e-7 * GON, 0.5e-6),
}


@pytest.mark.parametrize("name", DECIMALS)
@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-6, 1e-3])
def test_attitudes_at_a_phi_of_90_degrees_come_back(tmp_path, name, off):
    """And at 90 and -90 degrees of omega, where phi-omega-kappa is singular: within 1e-6 degrees."""
    agency, block, right = AGENCIES[name], random_job(11, CoordinateSystem.LOCAL), np.pi / 2
    singular = [[0.3, right, 0.4], [0.0, right, 2.8], [-1.2, -right, -0.3], [right, 0.2, 0.5], [-right, 0.0, 1.0]]
    for number, angles in enumerate(singular):
        attitude = np.tile(angles, (len(block.photos.ids), 1))
        attitude[np.abs(attitude) == right] += np.radians(off)
        looking = altered(block, photos={"attitude": attitude})
        folder = tmp_path / str(number)
        folder.mkdir()
        agency.dump_one(looking, folder / PLACES[name])
        back = agency.load_one(folder / PLACES[name], deck_of(block, tmp_path))
        np.testing.assert_allclose(
            attitude_matrix(back.photos.attitude), attitude_matrix(attitude), rtol=0, atol=np.radians(1e-6)
        )


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("name", DECIMALS)
def test_what_a_family_holds_comes_back(tmp_path, name, system):
    block = random_job(3, system)
    agency, (metres, radians, millimetres) = AGENCIES[name], DECIMALS[name]
    agency.dump_one(block, tmp_path / PLACES[name])
    again = agency.load_one(tmp_path / PLACES[name], deck_of(block, tmp_path))
    metres_of = _metres(block)
    # Arithmetic with geocentric coordinates of 6e6 m adds up to 1e-8 m.
    allowed = 2.0 * (0.5e-4 * ARC_SECOND * 6.4e6 if name == "giant" and _is_geographic(system) else metres) + 1e-8
    assert np.abs(metres_of(again.photos.position) - metres_of(block.photos.position)).max() < allowed
    turned = (again.photos.attitude - block.photos.attitude + np.pi) % (2.0 * np.pi) - np.pi
    # Rotating into geocentric axes and back mixes the three angles; tilts are up to 1.2 rad: 1/cos is 2.8.
    assert np.abs(turned).max() < 4.0 * radians
    np.testing.assert_array_equal(again.photos.ids, block.photos.ids)
    np.testing.assert_array_equal(again.points.bathymetric, block.points.bathymetric)
    np.testing.assert_array_equal(again.points.dry, block.points.dry)
    assert again.photos.tide.tolist() == pytest.approx(block.photos.tide.tolist())
    ours, theirs = _images(block), _images(again)
    assert list(ours) == list(theirs)
    assert np.abs(np.array(list(ours.values())) - list(theirs.values())).max() < millimetres * (1 + 1e-6)


def _is_geographic(system):
    return system is CoordinateSystem.GEOGRAPHIC


def _metres(block):
    """Return the function that turns positions of the block's system into metres."""
    if not _is_geographic(block.options.system):
        return lambda position: position
    return Ellipsoid(block.ellipsoid.name).geocentric


def _images(block):
    photos, points = block.photos.ids[block.plates.photo], block.points.ids[block.plates.point]
    return dict(zip(zip(photos.tolist(), points.tolist(), strict=True), block.plates.xy.tolist(), strict=True))


@pytest.mark.parametrize("system", SYSTEMS)
def test_giant_holds_sigmas_and_partial_control(tmp_path, system):
    block = random_job(5, system)
    giant.dump_one(block, tmp_path / "job.img")
    again = giant.load_one(tmp_path, deck_of(block, tmp_path))
    # angles to 1e-6 seconds are 3e-5 m, and lengths to 1e-4 m
    np.testing.assert_allclose(again.photos.position_sigma, block.photos.position_sigma, rtol=0, atol=1e-4)
    np.testing.assert_allclose(again.plates.sigma, block.plates.sigma, rtol=0, atol=0.5e-6)  # mm, six decimals
    np.testing.assert_array_equal(again.photos.attitude_sigma, block.photos.attitude_sigma)  # none
    sigmas = {block.points.ids[p]: s for p, s in zip(block.control.point, block.control.sigma, strict=True)}
    known = again.control.known
    if _is_geographic(system):  # east and north of a point without position are nowhere
        known = known & ~np.isnan(again.control.position).any(axis=1, where=[True, True, False])[:, None]
    for point, sigma, is_known in zip(again.control.point, again.control.sigma, known, strict=True):
        np.testing.assert_allclose(sigma[is_known], sigmas[again.points.ids[point]][is_known], rtol=0, atol=1e-4)
    full = block.control.kind == ControlKind.FULL
    kept = full if system is CoordinateSystem.GEOCENTRIC else np.ones(len(full), dtype=bool)
    kinds = dict(zip(block.points.ids[block.control.point[kept]], block.control.kind[kept], strict=True))
    assert dict(zip(again.points.ids[again.control.point], again.control.kind, strict=True)) == kinds


def test_patb_makes_one_point_of_its_two_parts(tmp_path):
    block = in_system(CoordinateSystem.LOCAL)
    patb.dump_one(block, tmp_path / "job.con")
    text = (tmp_path / "job.con").read_text().split("-99")
    assert [len(part.split("\n")) - 2 + (number == 0) for number, part in enumerate(text[:2])] == [3, 4]
    again = patb.load_one(tmp_path / "job.con", deck_of(block, tmp_path))
    kinds = [ControlKind(kind).name for kind in again.control.kind]
    assert dict(zip(again.points.ids[again.control.point], kinds, strict=True)) == {
        "1101": "FULL",
        "1103": "VERTICAL",
        "1105": "FULL",
        "1107": "HORIZONTAL",
        "1109": "VERTICAL",
    }


def test_partial_control_is_left_out_where_no_axis_is_vertical(tmp_path):
    lines = patb.dump_one(in_system(CoordinateSystem.GEOGRAPHIC), tmp_path / "job.con")
    assert "patb holds no such horizontal control: 1 left out" in lines
    assert "patb holds no such vertical control: 2 left out" in lines


def test_what_cannot_be_held_is_counted(tmp_path):
    block = in_system(CoordinateSystem.LOCAL)
    plates = replace(block.plates, triangulated=np.arange(len(block.plates.photo)) > 1)
    lines = bingo.dump_one(replace(block, plates=plates), tmp_path)
    assert lines == (
        "bingo holds no titles: 1 left out",
        "bingo holds no options: 1 left out",
        "bingo holds no water: 1 left out",
        "bingo holds no cameras: 1 left out",
        "bingo holds no tides: 3 left out",
        "bingo holds no measurements kept out of the solution: 2 left out",
        "bingo holds no submerged flag of plates: 6 left out",
        "bingo holds no such horizontal control: 1 left out",
        "bingo holds no such vertical control: 2 left out",
        "bingo holds no standard deviations of control: 5 left out",
        "bingo holds no equal elevations: 1 left out",
        "bingo holds no air bases: 1 left out",
    )
    assert len((tmp_path / "image.dat").read_text().splitlines()) == 27 - 2 + 2 * 3


def test_covariances_of_control_are_counted_and_come_from_the_deck(tmp_path):
    """No agency's file holds them; its sigmas are those of the covariances."""
    block = in_system(CoordinateSystem.LOCAL)
    full = block.control.kind == ControlKind.FULL
    whole = altered(block, control={"correlation": np.where(full[:, None], [0.5] * 3, np.nan)})
    for name, agency in AGENCIES.items():
        (tmp_path / name).mkdir()
        lines = agency.dump_one(with_marks(whole, 4) if agency is jfk else whole, tmp_path / name / PLACES[name])
        assert f"{name} holds no control covariances: {full.sum()} left out" in lines
    again = patb.load_one(tmp_path / "patb" / "job.ori", deck_of(whole, tmp_path))
    assert again.control.correlated.sum() == full.sum()


def test_terrestrial_survey_is_left_out_with_words(tmp_path):
    bingo.dump_one(in_system(CoordinateSystem.LOCAL), tmp_path)
    place = tmp_path / "geoin.dat"
    place.write_text(place.read_text() + "HDIR 1101 1105 41.2071 0.0005\n")
    (warning,) = bingo.read(tmp_path, {})[1]
    assert warning.message.startswith("1 record 'HDIR' left out")
    assert "terrestrial survey are not adjusted here: adjust them first" in warning.message


def test_stations_without_attitude_are_left_out_where_one_row_says_both(tmp_path):
    block = in_system(CoordinateSystem.LOCAL)
    lines = bingo.dump_one(altered(block, photos={"attitude": put(1, np.nan)}), tmp_path)
    assert "bingo holds no stations without attitudes: 1 left out" in lines
    words = [line.split()[1] for line in (tmp_path / "itera.dat").read_text().splitlines()]
    assert words == ["841", "843"]


@pytest.mark.parametrize("count", [4, 8])
def test_the_first_readings_of_a_photo_are_its_fiducial_marks(tmp_path, count):
    block = with_marks(in_system(CoordinateSystem.LOCAL), count)
    family = families.agencies()["jfk"]
    if count == 8:
        folder = tmp_path / "jfk8"
        folder.mkdir()
        text = (family.folder / "jfk.toml").read_text().replace("fiducials = 4", "fiducials = 8")
        (folder / "jfk.toml").write_text(text)
        family = families.RecordSet(folder)
    family.dump_one(block, tmp_path / "job.jfk")
    again = family.load_one(tmp_path / "job.jfk", deck_of(block, tmp_path))
    np.testing.assert_array_equal(again.fiducial_measurements.xy, block.fiducial_measurements.xy)
    np.testing.assert_array_equal(again.fiducial_measurements.ids, block.fiducial_measurements.ids)
    ours, theirs = _images(block), _images(again)
    assert list(ours) == list(theirs)
    np.testing.assert_allclose(list(theirs.values()), list(ours.values()), rtol=1e-15)  # micrometres and back


def test_a_photo_is_named_by_strip_and_number(tmp_path):
    lines = [f"  12{photo:>3}{point:>5}{100 * point:>8}{-point:>8}" for photo in (7, 8) for point in range(1, 7)]
    (tmp_path / "job.jfk").write_text("\n".join(lines) + "\n")
    found, problems = families.agencies()["jfk"].read(tmp_path / "job.jfk", {})
    assert found["plates"]["plates.photo"].tolist() == ["12-7"] * 2 + ["12-8"] * 2
    assert found["fiducial_measurements"]["fiducial_measurements.xy"][1].tolist() == [0.2, -0.002]
    assert [problem.severity for problem in problems] == ["warning"] and "not refined" in problems[0].message


def test_photos_without_fiducial_marks_are_no_cards_of_readings(tmp_path):
    with pytest.raises(DeckError) as caught:
        jfk.dump_one(in_system(CoordinateSystem.LOCAL), tmp_path / "job.jfk")
    assert len(caught.value.problems) == 3 and "has 0 fiducial measurements" in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("name", AGENCIES)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_spoilt_files_are_read_or_refused_with_their_place(tmp_path_factory, name, seed):
    """Characters changed, taken away and put in anywhere: never anything but problems."""
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("spoilt")
    block = random_job(1, CoordinateSystem.GEOGRAPHIC)
    agency = AGENCIES[name]
    agency.dump_one(with_marks(block, 4) if agency is jfk else block, folder / PLACES[name])
    for path in folder.iterdir():
        data = bytearray(path.read_bytes())
        for _ in range(3):
            at = int(rng.integers(len(data)))
            data[at : at + int(rng.integers(0, 30))] = rng.choice([b"", b"x", b"\n", b" ", b"-99", b"1", b"\xff"])
        path.write_bytes(bytes(data))
    given = deck_of(block, tmp_path_factory.mktemp("deck"))
    try:
        families.agencies()[name].read(folder, parts.deck_parts(given))
    except DeckError as error:
        assert all(problem.file and str(folder) in problem.file for problem in error.problems)


# --- what files lack, and decks that give it ---


def test_missing_parts_are_named_and_not_guessed(tmp_path):
    bingo.dump_one(in_system(CoordinateSystem.LOCAL), tmp_path)
    with pytest.raises(DeckError) as caught:
        bingo.load_one(tmp_path)
    assert [problem.message.partition(":")[0].partition(";")[0] for problem in caught.value.problems] == [
        "the coordinate system of the job is not known",
        "no camera (CAM card)",
    ]
    with pytest.raises(DeckError, match=r"units of .* are those of the job"):
        giant.dump_one(in_system(CoordinateSystem.GEOGRAPHIC), tmp_path / "job.img")
        giant.load_one(tmp_path / "job.img")
    patb.dump_one(in_system(CoordinateSystem.LOCAL), tmp_path / "job.im")
    with pytest.raises(DeckError, match="the camera of a photo is not known"):
        patb.load_one(tmp_path / "job.im")


def test_a_deck_need_not_be_whole(tmp_path):
    block = in_system(CoordinateSystem.GEOGRAPHIC)
    bingo.dump_one(block, tmp_path)
    given = tmp_path / "camera.crd"
    given.write_bytes(deck(lambda lines: [one for one in lines if one[:3] in ("OPT", "ELL", "CAM", "TID")]))
    again = bingo.load_one(tmp_path, given)
    assert again.cameras.ids.tolist() == ["RC8"] and again.photos.tide.tolist() == [0.2, 0.25, 0.3]
    assert not again.points.bathymetric.any()  # no card says so
    given.write_bytes(deck(drop(3), lambda lines: [one for one in lines if one[:3] in ("OPT", "CAM")]))
    with pytest.raises(DeckError, match="needs an ellipsoid"):
        bingo.load_one(tmp_path, given)
    given.write_bytes(b"CAM RC8       l52.00000\n")
    with pytest.raises(DeckError, match="l52"):
        bingo.load_one(tmp_path, given)


@pytest.mark.parametrize(
    ("agency", "point", "photo", "expected"),
    [
        (patb, "-99", "841", "'-99' begins another kind of line"),
        (bingo, "#12", "841", "'#12' begins another kind of line"),
        (jfk, "1101", "-41", "'-41' has no strip and photo"),
        (jfk, "1101", "1-8410", "'8410' is not A3"),
    ],
)
def test_names_that_a_file_would_read_as_something_else_are_errors(tmp_path, agency, point, photo, expected):
    block = with_marks(in_system(CoordinateSystem.LOCAL), 4)
    ids, photos = block.points.ids.copy(), block.photos.ids.astype("<U8").copy()
    ids[0], photos[0] = point, photo
    block = altered(block, points={"ids": ids}, photos={"ids": photos})
    with pytest.raises(DeckError, match=expected):
        agency.dump_one(block, tmp_path / "job.im" if agency is patb else tmp_path)
    assert not list(tmp_path.iterdir())


def test_names_that_do_not_fit_are_all_reported(tmp_path):
    ids = in_system(CoordinateSystem.LOCAL).points.ids.astype("<U8").copy()
    ids[:2] = ["TOO LONG", "A B"]
    with pytest.raises(DeckError) as caught:
        bingo.dump_one(altered(in_system(CoordinateSystem.LOCAL), points={"ids": ids}), tmp_path)
    assert {problem.found for problem in caught.value.problems} == {"TOO LONG", "A B"}
    assert all("a text without blanks" in problem.message for problem in caught.value.problems)
    assert not list(tmp_path.iterdir())
