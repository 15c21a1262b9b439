"""Decks that state one two-media job in every system: `musat run` finds the same rays and the same points."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from cli.commands import musat
from musatpy.formats.cards.spec import card_formats_folder
from musatpy.formats.job_tables import card_family
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.fortran import parse_edit
from musatpy.geometry.collinearity import AngleForm
from musatpy.geometry.systems import Geographic
from musatpy.model import Block, SystemSpec
from musatpy.systems import Statement
from musatpy.units import AngleUnit
from record_rows import read_rows
from reference.earth import earth_of
from reference.networks import Plan
from reference.networks import simulate as network
from systems.stated_jobs import (
    CLARKE,
    FALSE,
    FEET,
    ORIGIN,
    Words,
    coordinates,
    job,
    level_geoid,
    rays,
    statements,
    told,
)

RAYS = 1e-9  # rad
POINTS = 1e-5  # m
POK = AngleForm.PHI_OMEGA_KAPPA
DEG, GON, RAD = AngleUnit.DEGREES, AngleUnit.GONS, AngleUnit.RADIANS

# As many decimals as the columns hold, so that what a deck rounds is less than what is asked of the answer ...
FINE = {"F9.5": "F9.6", "F8.4": "F8.5", "F10.4": "F10.5", "F11.4": "F11.5"}
# ... and wider columns for coordinates: 5 um, the best of 14 columns for geocentric ones, turn rays by 1e-9.
WIDE = {
    "x": ("[17, 32]", "F16.7"),
    "y": ("[33, 48]", "F16.7"),
    "z": ("[49, 63]", "F15.7"),
    "sigma_east": ("[64, 66]", "F3.2"),
    "sigma_north": ("[67, 69]", "F3.2"),
    "sigma_up": ("[70, 72]", "F3.2"),
}
PLANE = {"kind": "TANG", "origin": tuple(ORIGIN), "false": tuple(FALSE)}
UTM = {"kind": "PROJ", "definition": "EPSG:26717", "axes": "GRID"}
SPECS = {
    "geographic": SystemSpec(angles="POK"),
    "geographic, matrices": SystemSpec(angles="MATR", unit=DEG),
    "geographic, gons": SystemSpec(angles="POK", unit=GON),
    "geocentric": SystemSpec(kind="GEOC", axes="GEOC", angles="MATR"),
    "geocentric, azimuth": SystemSpec(kind="GEOC", axes="GRID", angles="ATS", unit=GON),
    "tangent plane": SystemSpec(**PLANE, axes="GRID", unit=RAD),
    "tangent plane, vertical": SystemSpec(**PLANE, angles="POK"),
    "UTM": SystemSpec(**UTM, angles="POK", unit=GON),
    "UTM, matrices": SystemSpec(**UTM, angles="MATR"),
    "UTM above a geoid": SystemSpec(**UTM, angles="ATS", unit=DEG),
    "feet": SystemSpec(kind="PROJ", definition=FEET, axes="GRID"),
}
NAMES = pytest.mark.parametrize("name", list(SPECS))


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    """A folder with the native cards, STX and CTX with wider columns for coordinates."""
    folder = shutil.copytree(card_formats_folder() / "musat", tmp_path_factory.mktemp("cards") / "wide")
    for name in ("stx", "ctx"):
        path = folder / f"{name}.toml"
        text, places = path.read_text(), f"{908854.5:16.7f}{-5953690.8158:16.7f}{2101885.6350:15.7f}"
        head = re.search(r'(?m)^sample = "(.{16})', text)[1]
        text = re.sub(r"(?m)^sample = .*$", f'sample = "{head}{places}{".50" * 3}00000001"', text)
        for field, (columns, edit) in WIDE.items():
            pattern = rf'(name = "{field}"\n)columns = .*\nedit = .*'
            text = re.sub(pattern, rf'\1columns = {columns}\nedit = "{edit}"', text)
        path.write_text(text)
    return folder


@pytest.fixture(scope="module")
def fine(wide):
    """These cards with finer decimals: for writing only, because a reader takes the point where it stands."""
    family = card_family(wide)
    return replace(family, cards={name: finer(card) for name, card in family.cards.items()})


def finer(card):
    fields = (replace(one, edit=parse_edit(FINE.get(str(one.edit), str(one.edit)))) for one in card.fields)
    return replace(card, fields=tuple(fields))


def run(folder, data: bytes, *options) -> dict:
    (folder / "job.crd").write_bytes(data)
    result = musat("run", folder / "job.crd", *options)
    assert result.exit_code == 0, result.stderr
    assert all(": note: sigma0" in line for line in result.stderr.splitlines())  # decks without errors
    return read_rows(folder / "job.json")


@pytest.fixture(scope="module")
def base(tmp_path_factory, fine) -> tuple[Block, dict]:
    """The job as a native deck holds it, and its record."""
    folder = tmp_path_factory.mktemp("base")
    data = deck_bytes(job(), fine)
    return read_deck(data), run(folder, data)


def words_of(name: str, folder) -> Words:
    more = Words(Statement(system=Geographic(CLARKE), form=POK))
    return {"geographic": more, "geographic, gons": more, **statements(folder)}[name]


def spec_of(name: str, folder) -> SystemSpec:
    return replace(SPECS[name], geoid=level_geoid(folder)) if "geoid" in name else SPECS[name]


def rays_and_points(record: dict, block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Adjusted rays (m, 3) of all images and points (p, 3), geocentric."""
    stations = {key: np.array([row[key] for row in record["stations"]]) for key in ("position", "attitude")}
    residual = np.array([row["residual"] for row in record["plates"]])
    level, earth = np.array([row["position"] for row in record["points"]]), earth_of(block)
    return rays(block, stations["position"], stations["attitude"], residual), earth.cartesian(level) + earth.origin


@pytest.mark.slow
@NAMES
def test_one_answer_from_decks(name, tmp_path, base, fine, wide, monkeypatch):
    """The words of the deck are those of PROJ and scipy; only its cards are written by what is tested."""
    block, native = base
    words = words_of(name, tmp_path)
    monkeypatch.setattr("musatpy.systems.stated", lambda block, statement: told(block, words))
    data = deck_bytes(replace(block, given_in=spec_of(name, tmp_path)), fine)
    monkeypatch.undo()
    record = run(tmp_path, data, "--formats", str(wide))
    found, expected = rays_and_points(record, block), rays_and_points(native, block)
    np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=RAYS)
    np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=POINTS)
    # the answer is in the words of the deck
    level = np.array([row["position"] for row in native["points"]])
    stated = np.array([row["position"] for row in record["stated"]["points"]])
    rate = [6.4e6, 6.0e6, 1.0] if "geographic" in name else [0.3, 0.3, 1.0] if name == "feet" else [1.0, 1.0, 1.0]
    np.testing.assert_allclose((stated - coordinates(block, words, level)) * rate, 0.0, rtol=0, atol=POINTS)


@pytest.mark.slow
@NAMES
def test_decks_are_written_again_to_the_byte(name, tmp_path, base):
    block, _ = base
    spec = spec_of(name, tmp_path)
    data = deck_bytes(replace(block, given_in=spec, stated_in=replace(spec, sigmas="SYST")))
    again = read_deck(data)
    for card, before in zip(deck_bytes(again).decode().splitlines(), data.decode().splitlines(), strict=True):
        if card.startswith("MAT"):  # the rotation nearest to rounded elements may round otherwise
            elements = [[float(text[first : first + 16]) for first in (15, 32, 49)] for text in (card, before)]
            np.testing.assert_allclose(*elements, rtol=0, atol=1.1e-13)
        else:
            assert card == before
    assert again.given_in.kind == spec.kind
    assert (again.given_in.definition, again.given_in.geoid) == (spec.definition, spec.geoid)
    assert (again.given_in.axes, again.given_in.angles, again.given_in.unit) == (spec.axes, spec.angles, spec.unit)
    assert (again.given_in.sigmas, again.stated_in.sigmas) == ("LOCL", "SYST")


def test_a_local_deck_has_other_angles(tmp_path):
    """Nothing but the form of the angles can differ: both decks stand in the same rectangular system."""
    block = network(Plan(photos_per_strip=3)).block
    native = run(tmp_path, deck_bytes(block))
    spec = SystemSpec(kind="LOCL", axes="GRID", angles="POK", unit=GON)
    again = read_deck(deck_bytes(replace(block, given_in=spec)))
    # gons of ten decimals against seconds of four
    np.testing.assert_allclose(again.photos.attitude, block.photos.attitude, rtol=0, atol=3e-10)
    record = run(tmp_path, deck_bytes(replace(again, given_in=spec)))
    for row, expected in zip(record["points"], native["points"], strict=True):
        # angles that cards round are only approximations here: the limits of the iteration are what is left
        np.testing.assert_allclose(row["position"] or 0.0, expected["position"] or 0.0, rtol=0, atol=POINTS)
    assert record["stated"]["answer"]["text"].startswith("local rectangular; phi, omega, kappa")
    assert record["options"]["system"] == "LOCL"


@pytest.mark.slow
def test_the_option_card_need_not_say_the_system(tmp_path, base):
    block, _ = base
    data = deck_bytes(replace(block, given_in=SPECS["UTM"]))
    blank = data.replace(b"OPT IIA  GEOG", b"OPT IIA      ")
    assert blank != data
    assert run(tmp_path, blank)["points"] == run(tmp_path, data)["points"]


def test_sigmas_of_what_is_stated(base):
    """Sigmas along the axes of the grid, in its unit; equal ones are the same along east and north."""
    block, _ = base
    data = deck_bytes(replace(block, given_in=replace(SPECS["feet"], sigmas="SYST")))
    card = next(line for line in data.decode().splitlines() if line.startswith("STX"))
    # .5 m are 1.6404 feet, less 2e-4 for the map there and 5e-4 for the height of the station
    assert [float(card[first : first + 5]) for first in (57, 62, 67)] == pytest.approx(
        [1.6393, 1.6393, 0.5], abs=6e-4
    )
    again = read_deck(data)
    # three decimals on the card
    np.testing.assert_allclose(again.photos.position_sigma, block.photos.position_sigma, rtol=5e-4)
    np.testing.assert_allclose(again.control.sigma, block.control.sigma, rtol=5e-3)


def test_covariances_of_geocentric_coordinates_stay_whole(base):
    """F' C F on the cards, with the rows east, north, up of F, and C again in the job."""
    block, _ = base
    full = (block.control.kind == 0) & ~block.control.fixed
    correlation = np.where(full[:, None], [0.8, -0.5, -0.7], np.nan)
    sigma = np.where(full[:, None], [0.05, 0.2, 0.6], block.control.sigma)
    block = replace(block, control=replace(block.control, sigma=sigma, correlation=correlation))
    data = deck_bytes(replace(block, given_in=replace(SPECS["geocentric"], sigmas="SYST")))
    cards = [line for line in data.decode().splitlines() if line.startswith("CTC")]
    frame, C = earth_of(block).frame(block.control.position[full]), block.control.covariance[full]
    expected = frame.swapaxes(1, 2) @ C @ frame
    for card, matrix in zip(cards, expected, strict=True):
        numbers = [float(card[first : first + 9]) for first in range(13, 72, 10)]
        sigmas = np.sqrt(np.diagonal(matrix))
        np.testing.assert_allclose(numbers[:3], sigmas, atol=1e-6)
        np.testing.assert_allclose(
            numbers[3:], (matrix / np.outer(sigmas, sigmas))[[0, 0, 1], [1, 2, 2]], atol=1e-6
        )
    np.testing.assert_allclose(read_deck(data).control.covariance[full], C, atol=1e-6)


def test_sigmas_of_latitudes_are_thousandths_of_an_arc_second(base):
    block, _ = base
    spec = SystemSpec(sigmas="SYST", unit=DEG)
    data = deck_bytes(replace(block, given_in=spec))
    card = next(line for line in data.decode().splitlines() if line.startswith("STD"))
    # .5 m over radii of curvature of 6 345 and, along the parallel, 6 024 km
    assert [float(card[first : first + 5]) for first in (57, 62, 67)] == pytest.approx(
        [16.25, 17.12, 0.5], abs=0.01
    )
    again = read_deck(data)
    np.testing.assert_allclose(again.photos.position_sigma, block.photos.position_sigma, rtol=1e-3)
    np.testing.assert_allclose(again.control.sigma, block.control.sigma, rtol=1e-3)
