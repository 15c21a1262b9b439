"""`musat convert`: which family is which, what is said and written, and how it ends."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from musatpy.formats.musat import read_deck
from musatpy.runs import run_deck

convert = partial(musat, "convert")

ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"


@pytest.mark.parametrize(
    ("target", "written"),
    [
        ("job.im", ["job.con", "job.im", "job.ori"]),
        ("JOB.IMG", ["JOB.cnt", "JOB.frm", "JOB.img"]),
        ("geoin.dat", ["geoin.dat", "image.dat", "itera.dat"]),
    ],
)
def test_there_and_back(tmp_path, target, written):
    result = convert(DECK, tmp_path / target)
    assert (result.exit_code, result.stderr) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == written
    lines = result.stdout.splitlines()
    assert sorted(lines[:3]) == [f"wrote {tmp_path / name}" for name in written]
    assert sum("holds no tides: 3 left out" in line for line in lines) == 1
    back = tmp_path / "back.crd"
    result = convert(tmp_path / written[1], back, "--deck", DECK)
    assert (result.exit_code, result.stdout) == (0, f"wrote {back}\n")
    np.testing.assert_allclose(read_deck(back).plates.xy, read_deck(DECK).plates.xy, rtol=0, atol=1e-9)  # mm


def test_a_converted_job_has_the_same_solution(tmp_path):
    """Images and orientations through PAT-B; its control file cannot hold vertical control of a geographic job."""
    convert(DECK, tmp_path / "job.im")
    (tmp_path / "job.con").unlink()
    convert(tmp_path / "job.ori", tmp_path / "job.crd", "--deck", DECK)
    first, second = (run_deck(deck, tmp_path / "out").solution for deck in (DECK, tmp_path / "job.crd"))
    ids = [solution.block.points.ids.tolist() for solution in (first, second)]
    same = [ids[1].index(point) for point in ids[0]]
    apart = np.abs(first.points.position - second.points.position[same])
    assert np.isfinite(apart).all(axis=1).sum() >= 20
    # Starting values differ by up to 1e-5 m, and an iteration ends below 1e-3 m, its last step far below that.
    assert np.nanmax(apart[:, 2]) < 1e-5 and np.nanmax(apart[:, :2]) < 1e-5 / 6.4e6


def test_between_other_agencies_no_deck_is_needed_where_none_says_more(tmp_path):
    convert(DECK, tmp_path / "itera.dat")
    result = convert(tmp_path / "itera.dat", tmp_path / "own.ori", "--deck", DECK)
    assert result.exit_code == 0
    again = convert(tmp_path / "own.ori", tmp_path / "out", "--to", "bingo", "--deck", DECK)
    assert again.exit_code == 0 and (tmp_path / "out" / "itera.dat").exists()
    one, other = ((folder / "itera.dat").read_text().split() for folder in (tmp_path, tmp_path / "out"))
    assert one == other


def test_what_a_deck_lacks_to_run_is_one_list_and_the_status_says_so(tmp_path):
    convert(DECK, tmp_path / "itera.dat")
    (tmp_path / "geoin.dat").unlink()
    lines = DECK.read_text().splitlines(keepends=True)
    (tmp_path / "given.crd").write_text("".join(line for line in lines if line[:3] in ("OPT", "ELL", "CAM")))
    result = convert(tmp_path / "itera.dat", tmp_path / "job.crd", "--deck", tmp_path / "given.crd")
    assert result.exit_code == 3 and (tmp_path / "job.crd").exists()
    assert result.stderr.splitlines() == [
        f"musat: {tmp_path / 'job.crd'} will not run as it stands; it lacks:",
        "musat: - the block has no horizontally and no vertically known points or stations: its datum needs 2 "
        "horizontal and 3 vertical ones, or observed stations: a --deck that says it",
    ]


OPTIONS = ("--camera", "RC8=152.25,0.01,-0.005", "--set", "OPT.system=GEOC", "--set", "ELL.name=clrk66")
SIGMAS = ("--control-sigma", "0.1,0.2", "--plate-sigma", "5")


def test_a_job_of_files_and_options_runs(tmp_path):
    convert(DECK, tmp_path / "job.im")
    lacks = convert(tmp_path / "job.im", tmp_path / "job.crd")
    assert lacks.exit_code == 1 and not (tmp_path / "job.crd").exists()
    options = ["--camera NAME=FOCAL_LENGTH (mm) or a table", "--set OPT.system=GEOG, GEOC or LOCL"]
    assert [line.split(": ")[-1].partition(", or a --deck")[0] for line in lacks.stderr.splitlines()] == options
    lacks = convert(tmp_path / "job.im", tmp_path / "job.crd", *OPTIONS)
    assert lacks.exit_code == 3
    assert lacks.stderr.splitlines()[1:] == [
        "musat: - the east, north, up components are known and not fixed: they need sigmas (4 cards): "
        "--control-sigma EAST,NORTH,UP"
    ]
    made = convert(tmp_path / "job.im", tmp_path / "job.crd", *OPTIONS, *SIGMAS)
    assert (made.exit_code, made.stderr) == (0, "")
    assert made.stdout == f"sigmas 0.1, 0.1, 0.2 m: 4 control points\nwrote {tmp_path / 'job.crd'}\n"
    block = read_deck(tmp_path / "job.crd")
    assert block.control.sigma.tolist() == [[0.1, 0.1, 0.2]] * 4 and block.options.plate_sigma == 0.005
    assert block.cameras.focal_length == [152.25] and block.cameras.principal_point.tolist() == [[0.01, -0.005]]


def test_cameras_of_a_table_beside_a_deck(tmp_path):
    convert(DECK, tmp_path / "job.im")
    (tmp_path / "cameras.csv").write_text("camera;focal_length;xp;yp\nRC8;152,25;0,01;-0,005\n")
    (tmp_path / "given.crd").write_text("OPT IIA  GEOC\nELL clrk66\n")
    more = ("--deck", tmp_path / "given.crd", "--camera", tmp_path / "cameras.csv", *SIGMAS)
    assert convert(tmp_path / "job.im", tmp_path / "job.crd", *more).exit_code == 0
    given = convert(tmp_path / "job.im", tmp_path / "other.crd", *OPTIONS, *SIGMAS)
    assert given.exit_code == 0
    assert (tmp_path / "job.crd").read_bytes() == (tmp_path / "other.crd").read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--control-sigma a", "'a' is not numbers with commas between them"),
        ("--control-sigma 1,-1", "'1,-1' has a number that is not greater than zero"),
        ("--plate-sigma 0", "'--plate-sigma'"),
        ("--camera RC8=1,2", "--camera RC8=1,2: not NAME=FOCAL or NAME=FOCAL,X,Y"),
        ("--camera RC8=x", "--camera: CAM.focal_length: 'x' is not a number"),
        ("--camera RC8=-152", "--camera RC8=-152: "),
        ("--set OPT.system=UTM", "--set: OPT.system: 'UTM' is not A4 (one of GEOG, GEOC, LOCL)"),
    ],
)
def test_options_that_say_nothing(tmp_path, options, message):
    convert(DECK, tmp_path / "job.im")
    result = convert(tmp_path / "job.im", tmp_path / "job.crd", *options.split())
    assert result.exit_code == 2 and message in result.stderr and not (tmp_path / "job.crd").exists()


PIX4D = """\
P1060498 H_8.07_6.0525
1006 -1.90643 1.83493
1020 2.00132 -0.797681

P1060499 H_8.07_6.0525

1006 -2.42102 1.87814
1020 2.15263 -0.33399
"""  # as printed, support.pix4d.com article 203590305


@pytest.mark.parametrize("ends", [0, 1, 2])
def test_the_sample_of_pix4d(tmp_path, ends):
    """Without -99 it is read as if they stood there; a point that lacks a coordinate is no header."""
    text = PIX4D.replace("\nP1060499", "-99\nP1060499") if ends else PIX4D
    (tmp_path / "image.dat").write_text(text + "-99\n" * (ends == 2))
    result = convert(tmp_path / "image.dat", tmp_path / "job.im", "--camera", "H=8.07", "--set", "OPT.system=LOCL")
    assert result.exit_code == 0
    missing = {0: "before this line: read as if it stood there (2 in all)", 1: "at the end of the file: read"}
    assert result.stderr.count("-99 is missing") == (ends < 2) and missing.get(ends, "") in result.stderr
    words = (tmp_path / "job.im").read_text().split()
    points = "1006 -1906.430 1834.930 1020 2001.320 -797.681", "1006 -2421.020 1878.140 1020 2152.630 -333.990"
    assert " ".join(words) == f"P1060498 {points[0]} -99 P1060499 {points[1]} -99"
    (tmp_path / "image.dat").write_text(PIX4D.replace("1020 2.00132 -0.797681", "1020 2.00132"))
    result = convert(tmp_path / "image.dat", tmp_path / "job.im", "--camera", "H=8.07", "--set", "OPT.system=LOCL")
    assert result.exit_code == 1 and "image.dat:3 col 13 point.y: blank" in result.stderr


def test_words_behind_the_last_field_of_patb_are_told_once(tmp_path):
    convert(DECK, tmp_path / "job.im")
    plain = convert(tmp_path / "job.im", tmp_path / "one.crd", *OPTIONS, *SIGMAS)
    text = (tmp_path / "job.im").read_text()
    (tmp_path / "job.im").write_text("".join(f"{line} 1 0\n" for line in text.splitlines()))
    result = convert(tmp_path / "job.im", tmp_path / "two.crd", *OPTIONS, *SIGMAS)
    assert (plain.exit_code, result.exit_code) == (0, 0)
    assert (tmp_path / "one.crd").read_bytes() == (tmp_path / "two.crd").read_bytes()
    told = [line for line in result.stderr.splitlines() if "job." in line]
    assert len(told) == 1 and "'0' stands behind the last field: left out (54 lines in all)" in told[0]


def test_an_own_family_takes_the_place_of_one_of_its_name(tmp_path):
    own = tmp_path / "patb"
    shutil.copytree(ROOT / "card_formats" / "patb", own)
    layout = own / "im.toml"
    layout.write_text(
        layout.read_text()
        .replace('unit = "um"', 'unit = "mm"')
        .replace("    83845.000    -66905.000", "       83.845       -66.905")
    )
    out = tmp_path / "out.im"
    assert convert(DECK, out, "--formats", own).exit_code == 0
    assert out.read_text().split()[:4] == ["21", "102", "3.991", "85.033"]  # less the principal point


def test_sigmas_keep_all_digits_that_their_fields_hold(tmp_path):
    """A plate sigma of .31924 um was written as .32, and with it sigma0 went by 0.24 %, in silence."""
    deck = tmp_path / "job.crd"
    lines = DECK.read_text().splitlines()
    for number, line in enumerate(lines):
        if line.startswith("OPT"):
            lines[number] = line[:64] + " .31924" + line[71:]
        if line.startswith("CTG") and line[57:62].strip():
            lines[number] = line[:57] + ".3333" + line[62:]
    deck.write_text("\n".join(lines) + "\n")
    convert(deck, tmp_path / "again.crd", "--to", "musat")
    ours, theirs = read_deck(deck), read_deck(tmp_path / "again.crd")
    assert ours.options.plate_sigma == theirs.options.plate_sigma == pytest.approx(0.31924e-3, rel=1e-12)
    assert (ours.control.sigma[:, 0] == 0.3333).any()
    np.testing.assert_array_equal(theirs.control.sigma, ours.control.sigma)
    convert(deck, tmp_path / "other.img", "--to", "giant")
    convert(tmp_path / "other.img", tmp_path / "back.crd", "--deck", DECK)
    back = read_deck(tmp_path / "back.crd").control
    # GIANT has seconds of arc in F10.6: ten columns hold eight digits of a hundredth of a second
    np.testing.assert_allclose(back.sigma[:4], ours.control.sigma[:4], rtol=1e-6)


OWN = ROOT / "fixtures" / "trust" / "own_family"  # positions in m, coordinates those of the job


def test_units_that_are_not_those_of_the_jobs_system_are_refused(tmp_path):
    """Radians with four decimals were written of a geographic job, with status 0."""
    result = convert("--formats", OWN, DECK, tmp_path / "job.eo")
    assert (result.exit_code, list(tmp_path.iterdir())) == (1, [])
    for name in "xy":
        expected = (
            f"eo.toml: photo: {name}: unit: 'm', expected `job` or an angle, or coordinates = \"rectangular\""
        )
        assert expected in result.stderr
    assert "in a GEOG job" in result.stderr and ": z:" not in result.stderr


@pytest.mark.parametrize(("name", "count"), [("job", 1), ("rectangular", 0)])
def test_metres_are_right_in_a_local_job_and_where_the_file_is_rectangular(tmp_path, name, count):
    own = tmp_path / "own"
    shutil.copytree(OWN, own)
    text = (own / "eo.toml").read_text().replace('coordinates = "job"', f'coordinates = "{name}"')
    (own / "eo.toml").write_text(text)
    assert convert("--formats", own, DECK, tmp_path / "job.eo").exit_code == count
    local = ROOT / "fixtures" / "trust" / "local_run.crd"
    result = convert("--formats", own, local, tmp_path / "local.eo")
    assert result.exit_code == 0
    result = convert("--formats", own, "--deck", local, tmp_path / "local.eo", tmp_path / "back.crd")
    assert result.exit_code == 0
    np.testing.assert_allclose(
        read_deck(tmp_path / "back.crd").photos.position, read_deck(local).photos.position, rtol=0, atol=5e-5
    )


@pytest.mark.parametrize(
    ("unit", "other", "target", "message"),
    [
        ("m", "deg", "photos.position[2]", "z: unit: 'deg'"),
        ("m", "deg", "photos.position[0]", "y: unit: 'm', expected `job` or an angle"),
        ("deg", "m", "photos.attitude[1]", "phi: unit: 'm'"),
    ],
)
def test_units_that_no_job_can_have_are_refused_at_loading(tmp_path, unit, other, target, message):
    own = Path(shutil.copytree(OWN, tmp_path / "own"))
    text = (own / "eo.toml").read_text()
    old = f'unit = "{unit}"\ntarget = "{target}"'
    assert text.count(old) == 1
    (own / "eo.toml").write_text(text.replace(old, f'unit = "{other}"\ntarget = "{target}"'))
    result = convert("--formats", own, ROOT / "fixtures" / "trust" / "local_run.crd", tmp_path / "job.eo")
    assert result.exit_code == 1 and "eo.toml: photo" in result.stderr
    assert message in result.stderr and "expected" in result.stderr
