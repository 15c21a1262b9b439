"""`musat sea fit` and `musat correct --sea`: what they write, say, and refuse."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

import sea_fixtures
from cli.commands import musat
from json_schema import load_schema, violations
from musatpy.model import CoordinateSystem
from musatpy.reports.record import dumps
from musatpy.reports.record import record as record_of_run
from musatpy.sea.stereo import surface_file
from musatpy.sea.stereo.grid import GridSurface
from record_rows import with_columns, with_rows
from sample_solutions import sample_solution

SEA = sea_fixtures.SEA
SCHEMA = Path(surface_file.__file__).with_name("surface.schema.json")


def fitted(folder: Path, *options: object) -> Path:
    result = musat("sea", "fit", SEA / "water.csv", "-o", folder, *options)
    assert result.exit_code == 0, result.output
    return folder / "water.surface.json"


def correct(folder: Path, surface: Path, *options: object, points: Path = SEA / "bottom.csv") -> Result:
    return musat(
        "correct", points, "--sea", surface, "--stations", SEA / "cameras.csv", "--index", 1.34,
        "-o", folder / "true.csv", *options,
    )  # fmt: skip


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_fixture_is_what_the_simulation_makes() -> None:
    for name, text in sea_fixtures.files().items():
        assert (SEA / name).read_text() == text, name


@pytest.mark.slow
@pytest.mark.parametrize(("model", "rejected"), [("fourier", 3), ("grid", 4)])
def test_a_height_of_no_water_is_listed_as_rejected(tmp_path: Path, model: str, rejected: int) -> None:
    lines = (SEA / "water.csv").read_text().splitlines()
    first = lines[1].split(",")
    first[3] = "1e9"
    (tmp_path / "water.csv").write_text("\n".join([lines[0], ",".join(first), *lines[2:]]) + "\n")
    result = musat("sea", "fit", tmp_path / "water.csv", "--model", model, "--plots")
    assert result.exit_code == 0, result.output
    assert f"{rejected} points rejected" in result.output
    report = (tmp_path / "water.surface.txt").read_text()
    assert f"from 400 points, {rejected} rejected" in report
    assert "Rejected\n    W1: 1e+09 m off the median height: no water over these points goes beyond " in report
    assert "    W18: residual" in report and "    W231: residual" in report
    record = json.loads((tmp_path / "water.surface.json").read_text())
    assert (record["points"], record["rejected"]) == (400 - rejected, rejected)
    assert (tmp_path / "water.surface.png").read_bytes().startswith(b"\x89PNG")


def test_waves_of_the_pair_and_its_bottom(tmp_path: Path) -> None:
    surface = fitted(tmp_path)
    report = (tmp_path / "water.surface.txt").read_text()
    assert "W18: residual" in report and "W231: residual" in report
    result = correct(tmp_path, surface)
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[-1].endswith("40 points, 40 corrected")
    truth = {row["id"]: row for row in rows(SEA / "truth.csv")}
    ratio, wave = [], []
    for row in rows(tmp_path / "true.csv"):
        error = [float(row[f"true_{axis}"]) - float(truth[row["id"]][axis]) for axis in "xyz"]
        sigma = [float(row[f"sigma_{axis}"]) for axis in ("east", "north", "height")]
        ratio.append(np.array(error) / sigma)
        wave.append(float(row["sigma_surface"]))
    # 40 points: the root mean square of a deviate is within 3/(2 x 40)^1/2 of 1
    assert (np.abs(np.sqrt(np.mean(np.square(ratio), axis=0)) - 1.0) < 0.34).all()
    assert max(wave) < 0.01


@pytest.mark.slow
def test_the_grid_of_the_pair(tmp_path: Path) -> None:
    surface = fitted(tmp_path, "--model", "grid", "--spacing", "20", "--curvature", "0.005")
    text = (tmp_path / "water.surface.txt").read_text()
    assert "nodes 20.00 m apart" in text and "Curvature 0 with a sigma of 0.00500 1/m" in text
    result = correct(tmp_path, surface)
    assert result.exit_code == 0, result.output
    table = rows(tmp_path / "true.csv")
    left = [row for row in table if row["reason"]]
    assert {row["reason"] for row in left} <= {"the surface is not known where its rays meet the water"}
    assert all(row["true_z"] == "" and row["sigma_height"] == "" for row in left)
    assert f"{len(left)} not corrected: the surface is not known" in result.output


@pytest.mark.parametrize("model", ["fourier", "grid"])
@pytest.mark.slow
def test_the_file_of_a_surface_obeys_its_schema_and_reads_back(tmp_path: Path, model: str) -> None:
    surface = fitted(tmp_path, "--model", model)
    schema = load_schema(SCHEMA)
    assert not list(violations(json.loads(surface.read_text()), schema, schema))
    read = surface_file.load_surface(surface)
    assert isinstance(read, GridSurface) == (model == "grid")
    again = tmp_path / "again"
    fitted(again, "--model", model)
    assert (again / "water.surface.json").read_bytes() == surface.read_bytes()
    assert len(read.shape_covariance(np.zeros((2, 1, 2)))) == 2


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    """The points of the water without their sigmas."""
    lines = (SEA / "water.csv").read_text().splitlines()
    (tmp_path / "plain.csv").write_text("".join(",".join(line.split(",")[:4]) + "\n" for line in lines))
    return tmp_path / "plain.csv"


@pytest.mark.slow
def test_sigmas_by_options(plain: Path, tmp_path: Path) -> None:
    """Those of the pair are what the file says, of all points alike they are not; one stands for three."""
    pair = ("--cameras", SEA / "cameras.csv", "--image-sigma", 5, "--focal", 152)
    assert musat("sea", "fit", plain, "-o", tmp_path / "a", *pair).exit_code == 0
    for name, sigma in (("b", "0.05"), ("c", "0.05,0.05,0.05")):
        assert musat("sea", "fit", plain, "-o", tmp_path / name, "--sigma", sigma).exit_code == 0
    texts = [(tmp_path / part / "plain.surface.json").read_text() for part in "abc"]
    record = [json.loads(text) for text in texts]
    assert texts[1] == texts[2]
    assert record[0]["sigma0"] == pytest.approx(1.03, abs=0.05)  # as the file's own sigmas, 1.027
    assert record[0]["sigma0"] != record[1]["sigma0"]


def test_coordinates_may_have_other_names(tmp_path: Path) -> None:
    for name in ("water.csv", "bottom.csv"):
        text = (SEA / name).read_text()
        (tmp_path / name).write_text(text.replace("id,x,y,z,", "id,East,North,h,", 1))
    renamed = ("--columns", "east, north, H")
    assert musat("sea", "fit", tmp_path / "water.csv", *renamed).exit_code == 0
    surface = tmp_path / "water.surface.json"
    assert surface.read_bytes() == fitted(tmp_path / "as_given").read_bytes()
    assert correct(tmp_path, surface, *renamed, points=tmp_path / "bottom.csv").exit_code == 0
    found = rows(tmp_path / "true.csv")
    assert correct(tmp_path, surface).exit_code == 0
    assert [row["true_z"] for row in found] == [row["true_z"] for row in rows(tmp_path / "true.csv")]


def test_quiet_commands_say_nothing(tmp_path: Path) -> None:
    result = musat("sea", "fit", SEA / "water.csv", "-o", tmp_path, "-q")
    assert (result.exit_code, result.output) == (0, "")
    result = correct(tmp_path, tmp_path / "water.surface.json", "--quiet")
    assert (result.exit_code, result.output) == (0, "")
    assert len(rows(tmp_path / "true.csv")) == 40


_CORRECTING = (("correct",), ("sea", "fit"), ("sea", "correct"), ("sea", "interpolate"))


@pytest.mark.parametrize(
    ("columns", "message"),
    [("x,y", "three names are needed"), ("x,,z", "three names are needed"), ("x,X,z", "has a name twice")],
)
@pytest.mark.parametrize("command", _CORRECTING)
def test_columns_need_three_names(command: tuple[str, ...], columns: str, message: str) -> None:
    result = musat(*command, "a", "--columns", columns)
    assert result.exit_code == 2 and message in result.output


@pytest.mark.parametrize("path", ["job.json", "cloud.las", "cloud.LAZ"])
def test_files_without_names_have_no_others(path: str) -> None:
    result = musat("sea", "fit", path, "--columns", "a,b,c", "--sigma", 1)
    assert result.exit_code == 2 and "have no other names" in " ".join(result.output.split())


def test_the_record_of_a_run_is_read(tmp_path: Path) -> None:
    water = rows(SEA / "water.csv")
    points = [
        {
            "point": row["id"],
            "position": [float(row[axis]) for axis in "xyz"],
            "covariance": np.diag([float(row[f"s{axis}"]) ** 2 for axis in "xyz"]).tolist(),
        }
        for row in water
    ]
    lost = {"point": "W999", "position": [None] * 3, "covariance": [[None] * 3] * 3}
    path = tmp_path / "job.json"
    fixed = {**points[0], "point": "W998", "covariance": np.zeros((3, 3)).tolist()}
    run = with_rows(json.loads(dumps(record_of_run(sample_solution(CoordinateSystem.LOCAL)))))
    named = [*points, lost, fixed, {**points[0], "point": "LAND"}]
    run["points"] = [run["points"][0] | row for row in named]
    path.write_text(json.dumps(with_columns(run)))
    assert musat("sea", "fit", path, "--only", "W*").exit_code == 0
    text = (tmp_path / "job.surface.txt").read_text()
    assert "from 400 points, 2 rejected" in text
    assert "left out: point W999: no position with a covariance" in text
    assert "left out: point W998: no position with a covariance" in text


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        ("id,x,y,depth\n", ["no column z [m] among id, x, y, depth", "unknown column depth", "no columns sx, sy"]),
        (
            "id,x,y,z,sx,sy,sz\na,1,2,3,1,1,1\n,1,2,x3,1,1,0\n",
            [
                "bad.csv:3 col 1 id: is missing",
                "bad.csv:3 cols 6-7 z: 'x3' is not a number",
                "bad.csv:3 col 13 sz: '0' is not a number greater than zero",
            ],
        ),
        ("id,x,y,z,sx,sy,sz\na,1,2,3,1,1,1\nb,2,3,4,1,1,1\n", ["2 surface points: at least 8 are needed"]),
    ],
)
def test_bad_points_are_all_reported(tmp_path: Path, text: str, messages: list[str]) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    result = musat("sea", "fit", path)
    assert result.exit_code == 1
    for message in messages:
        assert message in result.output
    assert [one.name for one in tmp_path.iterdir()] == ["bad.csv"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--spacing", "5"], "--spacing is for the model grid"),
        (["--model", "grid", "--most", "2"], "--most is for the model fourier"),
        (["--image-sigma", "5"], "--image-sigma and --focal go together"),
        (["--image-sigma", "5", "--focal", "152"], "--image-sigma needs --cameras"),
        (["--sigma", "1,1,0"], "'1,1,0' has a number that is not greater than zero"),
        (["--image-sigma", "5", "--focal", "152", "--sigma", "1,1,1"], "one or the other"),
        (["--cameras", str(SEA / "cameras.csv"), "--pair", "L,X"], "no station X among L, R"),
        (["--cameras", str(SEA / "cameras.csv"), "--pair", "L"], "two names are needed"),
    ],
)
def test_wishes_that_contradict_are_errors_of_the_command_line(options: list[str], message: str) -> None:
    result = musat("sea", "fit", SEA / "water.csv", *options)
    assert result.exit_code == 2 and message in result.output


def test_wishes_that_cannot_be_met_are_errors(tmp_path: Path) -> None:
    for options, message in (
        (("--shortest", 900), "no wave is shorter than"),
        (("--sigma", "1,1,1"), "have sigmas of their own, so none can be given"),
        (("--only", "Q*"), "no point fits Q*"),
    ):
        result = musat("sea", "fit", SEA / "water.csv", "-o", tmp_path, *options)
        assert result.exit_code == 1 and message in result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record: record.pop("origin"), "no 'origin'"),
        (lambda record: record.update(schema_version="2.0"), "is of version 2.0"),
        (lambda record: record["fourier"]["parameters"].pop(), "are no level and waves"),
        (lambda record: record["fourier"].update(area=[1.0]), "area is not 2 by 2 numbers"),
        (lambda record: record["fourier"].update(covariance=(-np.eye(9)).tolist()), "is no file of a surface"),
        (lambda record: record.update(model="grid"), "no 'grid'"),
        (lambda record: record.update(model="splines"), "unknown model 'splines'"),
        (lambda record: record["fourier"]["covariance"][0].__setitem__(1, 1e-6), "covariance is not symmetric"),
        (lambda record: record["grid"]["x"].__setitem__(3, 1e3), "x are not evenly spaced nodes"),
    ],
)
def test_a_file_that_is_no_surface_is_an_error(tmp_path: Path, change, message: str) -> None:
    surface = fitted(tmp_path, "--model", "grid" if "nodes" in message else "fourier")
    record = json.loads(surface.read_text())
    change(record)
    surface.write_text(json.dumps(record))
    result = correct(tmp_path, surface)
    assert result.exit_code == 1 and message in result.output and "Traceback" not in result.output
    assert not (tmp_path / "true.csv").exists()


def test_files_that_are_not_what_is_asked_for(tmp_path: Path) -> None:
    surface = fitted(tmp_path)
    surface.write_text("{")
    assert "is no JSON" in correct(tmp_path, surface).output
    record = tmp_path / "other.json"
    record.write_text("{}")
    assert "is not the record of a run" in musat("sea", "fit", record).output
    surface = fitted(tmp_path)
    result = correct(tmp_path, surface, "-o", surface)
    assert result.exit_code == 2 and "would overwrite" in result.output
    assert correct(tmp_path, tmp_path / "none.json").exit_code == 1


def test_sigmas_that_no_point_needs_are_an_error(tmp_path: Path) -> None:
    surface, given = fitted(tmp_path), ("--pointing", 5, "--focal", 152, "--format", "228,228")
    result = correct(tmp_path, surface, *given)
    assert result.exit_code == 1 and "have sigmas of their own" in result.output
    assert not (tmp_path / "true.csv").exists()
    lines = (SEA / "bottom.csv").read_text().splitlines()
    rows_without = [",".join(line.split(",")[:4]) + ",,," for line in lines[1:]]
    (tmp_path / "some.csv").write_text("\n".join([*lines[:2], *rows_without[1:]]) + "\n")
    assert correct(tmp_path, surface, *given, points=tmp_path / "some.csv").exit_code == 0
    old = ("sea", "correct", tmp_path / "some.csv", "--surface", surface, "--cameras", SEA / "cameras.csv")
    sigmas = ("--index", 1.34, "--image-sigma", 5, "--focal", 152, "--only", "B1*", "-o", tmp_path / "old.csv")
    assert musat(*old, *sigmas).exit_code == 0
    named = {row["id"]: row for row in rows(tmp_path / "true.csv") if row["id"].startswith("B1")}
    assert {row["id"]: row for row in rows(tmp_path / "old.csv")} == named
