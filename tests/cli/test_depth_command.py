"""`musat depth`: what it prints and writes, and how it ends where something is missing or wrong."""

import contextlib
import os
import pty
import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from cli.commands import musat
from musatpy.files import is_alive
from musatpy.refraction.media import relative_index

depth = partial(musat, "depth")

ROOT = Path(__file__).parents[2]
LAGOON, TABLE_1 = ROOT / "fixtures" / "lagoon", ROOT / "fixtures" / "groeneveld_meijer" / "table1.csv"
PAIR = ("--height", 2500, "--base", 1126, "--index", 1.35)
CAMERAS = ("--cameras", LAGOON / "cameras.csv", "--index", 1.3398)
FORMAT = ("--focal", 152.4, "--format", "228.6,228.6")


def test_table_1_is_printed_as_in_the_paper() -> None:
    result = depth("table", *PAIR, "--at", TABLE_1)
    assert result.exit_code == 0
    head, names, *lines = result.output.splitlines()
    assert head == "Height 2500, base 1126, n = 1.35000, by formula"
    assert names.split() == ["d1", "d2", "s", "t", "F(0)", "F(10)", "F(25)", "F(50)", "F(100)"]
    printed = [line.split(",") for line in TABLE_1.read_text().splitlines()[1:]]
    apart = [
        abs(float(a) - float(b))
        for line, row in zip(lines, printed, strict=True)
        for a, b in zip(line.split(), row, strict=True)
    ]
    assert sum(value > 2.5e-4 + 5e-5 for value in apart) <= 2  # the two misprints; and the rounding of both


def test_a_grid_by_rays_and_by_stations(tmp_path: Path) -> None:
    grid = ("--grid", "3,3", "--depths", "0,25")
    by_rays = depth("table", *PAIR, "--exact", *grid).output.splitlines()
    assert by_rays[0].endswith("by rays") and len(by_rays) == 11
    cameras = tmp_path / "pair.csv"
    cameras.write_text("name,x,y,z,tide,omega,phi,kappa\n1,0,0,2500,0,0,0,0\n2,1126,0,2500,0,0,0,0\n")
    area = ("--area", "0,-1126,1126,1126")
    by_file = depth("table", "--cameras", cameras, "--index", 1.35, *area, *grid).output.splitlines()
    assert by_file[0] == "2 stations, n = 1.35000, by rays"
    assert by_file[1:] == by_rays[1:]


def test_errors_of_the_approximations() -> None:
    result = depth("errors", *PAIR, "--width", 2252, "--value", 1.41, "--grid", "21,41")
    assert result.exit_code == 0
    assert "One factor 1.4100 for the whole model, apparent depth 25" in result.output
    assert re.search(r"^ +1\.4000 +35\.000 +-0\.250 +-0\.71 ", result.output, re.MULTILINE)
    median = depth("errors", *PAIR, "--width", 2252)
    assert re.search(r"One factor 1\.4\d{3} for the whole model", median.output)


def test_errors_where_a_depth_has_no_factor() -> None:
    """Between the tides nothing is known: dashes, with the reason below."""
    result = depth("errors", *CAMERAS, *FORMAT, "--area", "-100,200,500,700", "--depths", "0,5")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[3].split() == ["0.000", *"--------"]
    assert re.match(r" +5\.000( +-?[\d.]+){8}$", lines[4])
    assert lines[-1] == "-: between the tides of its cameras"


def test_the_index_comes_from_conditions() -> None:
    conditions = ("--temperature", 20, "--chlorinity", 19.2, "--wavelength", 480)
    result = depth("table", "--height", 900, "--base", 540, *conditions)
    n = relative_index(480.0, 20.0, 1.80655 * 19.2)
    assert result.output.startswith(f"Height 900, base 540, n = {n:.5f}, by formula")


def test_a_liquid_that_is_not_water_has_a_name() -> None:
    result = depth("table", *PAIR[:4], "--index", 1.45, "--liquid", "GLYCEROL")
    assert result.output.startswith("Height 2500, base 1126, n = 1.45000, by formula")


def test_points_are_corrected(tmp_path: Path) -> None:
    out = tmp_path / "true.csv"
    result = depth("correct", LAGOON / "points.csv", "-o", out, *CAMERAS, *FORMAT, "--jobs", 1)
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[0] == f"{out}: 73 points, 63 corrected"
    assert "7 not corrected: only one camera sees it" in result.output
    assert len(out.read_text().splitlines()) == 74
    quiet = depth("correct", LAGOON / "points.csv", "-o", out, *CAMERAS, "--angle", 35, "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")


@pytest.mark.slow
def test_a_terminal_shows_progress(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    arguments = ["depth", "correct", LAGOON / "points.csv", "-o", tmp_path / "out.csv", *CAMERAS, *FORMAT]
    command = [sys.executable, "-c", "from musatpy.cli.main import main; main()", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs) as running:
        os.close(theirs)
        shown = b""
        with contextlib.suppress(OSError):  # how a terminal says that its other end is closed
            while part := os.read(ours, 1024):
                shown += part
        assert running.wait(timeout=60) == 0
    os.close(ours)
    assert b"points.csv" in shown and b"100%" in shown


@pytest.mark.slow
def test_a_killed_correction_leaves_no_process_and_no_half_file(tmp_path: Path) -> None:
    many = tmp_path / "many.csv"
    many.write_text("x,y,z\n" + "700,300,-4\n" * 400_000)
    out = tmp_path / "out.csv"
    arguments = ["depth", "correct", many, "-o", out, *CAMERAS, *FORMAT, "--jobs", 2]
    command = [sys.executable, "-c", "from musatpy.cli.main import main; main()", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as running:
        children = Path(f"/proc/{running.pid}/task/{running.pid}/children")
        workers: list[str] = []
        while not (workers and list(tmp_path.glob(".out.csv.*"))):
            assert running.poll() is None, "done before it could be killed"
            workers = children.read_text().split()
            time.sleep(0.05)
        running.kill()
    until = time.monotonic() + 3.0  # at once, on a machine that has time for it
    while any(is_alive(int(worker)) for worker in workers) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(is_alive(int(worker)) for worker in workers)
    assert not out.exists()
    assert depth("correct", LAGOON / "points.csv", "-o", out, *CAMERAS, *FORMAT, "--jobs", 1).exit_code == 0
    assert not list(tmp_path.glob(".out.csv.*"))  # what the killed one had begun is gone too


def test_other_names_of_columns(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text("North,East,H\n200,700,-4\n")
    out = tmp_path / "out.csv"
    result = depth("correct", points, "-o", out, *CAMERAS, *FORMAT, "--columns", "east,north,h")
    assert result.exit_code == 0, result.output
    assert out.read_text().splitlines()[1].startswith("200,700,-4,699.99")


POINTS = ("correct", LAGOON / "points.csv", "-o", "out.csv")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("table", "--height", 900, "--base", 500), "the water is not known: --index is needed"),
        (("table", *PAIR, "--temperature", 20), "one or the other, not both"),
        (
            ("table", *PAIR[:4], "--index", 1.45),
            "not within 1.3 to 1.4, as that of water is; another liquid is to be",
        ),
        (("table", *PAIR[:4], "--index", 2.01, "--liquid", "OIL"), "2.01 is not in the range 1.0<=x<=2.0"),
        (
            ("table", "--height", 900, "--base", 5, "--temperature", 31, "--salinity", 35, "--wavelength", 500),
            "0 to 30",
        ),
        (
            ("table", "--height", 9, "--base", 5, "--temperature", 5, "--salinity", 1, "--chlorinity", 1),
            "--salinity or --chlorinity",
        ),
        (("table", "--height", 900, "--index", 1.34), "--height and --base are needed, or --cameras"),
        (("table", *PAIR, "--cameras", LAGOON / "cameras.csv"), "--cameras replaces --height"),
        (("table", *PAIR, "--angle", 30), "go with --cameras"),
        (("table", *PAIR, "--exact", "--at", TABLE_1), "rays need x, y"),
        (("table", *PAIR, "--depths", "-1"), "an apparent depth is not less than zero"),
        (("table", *PAIR, "--depths", "1;2"), "'1;2' is not numbers with commas"),
        (("table", *PAIR, "--grid", "1,5"), "a whole number of places, 2 to 2000 each way"),
        (("table", *PAIR, "--grid", "nan,5"), "a number that is not finite"),
        (("table", "--height", 900, "--base", 500, "--index", "nan"), "'nan' is not a finite number"),
        (("errors", *PAIR, "--step", 1e-9), "levels, more than 1000"),
        (("table", *PAIR, "--area", "5,0,1,1"), "with the lower left corner first"),
        ((*POINTS, *CAMERAS), "what a camera sees is not known"),
        ((*POINTS, *CAMERAS, "--focal", 152), "--focal and --format go together"),
        ((*POINTS, *CAMERAS, *FORMAT, "--columns", "x,y"), "three names are needed"),
        (("correct", "in.csv", "-o", "in.csv", *CAMERAS, *FORMAT), "the result would overwrite in.csv"),
    ],
)
def test_a_command_line_that_says_too_little_or_too_much(arguments: tuple[object, ...], message: str) -> None:
    result = depth(*arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


@pytest.mark.slow
def test_a_picture_of_the_model(tmp_path: Path) -> None:
    result = depth("picture", tmp_path / "model.png", *PAIR, "--width", 2250)
    assert result.exit_code == 0, result.output
    assert result.output.strip() == f"{tmp_path / 'model.png'}: F 1.3651 to 1.4661"
    assert (tmp_path / "model.png").read_bytes().startswith(b"\x89PNG")
