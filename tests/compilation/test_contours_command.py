"""`musat as11 compare-contours`: the bottom of St. Thomas beside its own contours, and beside others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import stage_readings
from json_schema import violations
from musatpy.cli.main import main as musat
from musatpy.reports.contour_comparison import schema
from record_rows import read_rows, with_columns


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of the run of St. Thomas, beside the files of its compilation."""
    folder = tmp_path_factory.mktemp("run")
    deck = stage_readings.FIXTURES / "st_thomas/st_thomas.crd"
    assert CliRunner().invoke(musat, ["run", str(deck), "-q", "-o", str(folder)]).exit_code == 0
    record = folder / "st_thomas.json"
    command = ["as11", "compile", str(record), str(stage_readings.DECK), "-o", str(folder), "--gis"]
    assert CliRunner().invoke(musat, command).exit_code == 0
    return record


def compared(run: Path, file: Path, folder: Path, *options: str) -> Result:
    command = ["as11", "compare-contours", str(run), str(stage_readings.DECK), str(file), "-o", str(folder)]
    return CliRunner().invoke(musat, [*command, *options])


def test_the_contours_of_the_fixture_are_what_its_generator_writes() -> None:
    assert stage_readings.CONTOURS.read_text() == stage_readings.contours()


def test_contours_of_the_true_bottom(run: Path, tmp_path: Path) -> None:
    """To the scatter of the points, .3 m, and their sigmas, where no sliver of a triangle is steep."""
    assert compared(run, stage_readings.CONTOURS, tmp_path).exit_code == 0
    record = read_rows(tmp_path / "contours.contours.json")
    assert {row["depth"] for row in record["distances"]} == {4.0, 10.0, 20.0}
    for row in record["distances"]:
        assert abs(row["mean_depth"]) < 0.2 and row["most_depth"] < 1.0 and row["mean"] < 25.0
    reasons = {row["depth"]: row["reason"] for row in record["areas"] if row["surface"] == 1}
    assert not reasons[10.0] and "the surface goes from" in reasons[30.0]
    assert reasons[6.0] == "the other source has no contour of it"


@pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param("st_thomas_as11.contours.csv", (), marks=pytest.mark.slow),
        ("st_thomas_as11.gpkg", ("--layer", "contours")),
        pytest.param("st_thomas_as11.dxf", ("--datum", "-0.15"), marks=pytest.mark.slow),  # heights of the job
    ],
)
def test_contours_lie_on_themselves(run: Path, tmp_path: Path, name: str, options: tuple[str, ...]) -> None:
    """To the digits of the files."""
    file = run.with_name(name)
    assert compared(run, file, tmp_path, *options).exit_code == 0
    stem = tmp_path / f"{file.stem}.contours"
    record, of_record = read_rows(Path(f"{stem}.json")), schema()
    assert not list(violations(with_columns(record, of_record), of_record, of_record))
    assert len(record["areas"]) == 12 and not any(row["reason"] for row in record["areas"])
    for row in record["distances"]:
        assert row["most"] < 2e-3 and abs(row["mean_depth"]) < 1e-3
    listing = Path(f"{stem}.lst").read_text()
    assert max(map(len, listing.splitlines())) <= 132 and "Areas Between Contours" in listing


def test_a_shift_of_the_depths_shows_in_the_depths(run: Path, tmp_path: Path) -> None:
    """Lines of 8.0 m called 8.2 m: the compiled bottom is 0.2 m shoaler there, seen from both sources."""
    head, *rows = run.with_name("st_thomas_as11.contours.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    kept = [",".join([*row[:2], "8.2", *row[3:]]) for row in cells if row[2] == "8"]
    file = tmp_path / "s.csv"
    file.write_text("\n".join([head, *kept]) + "\n")
    result = compared(run, file, tmp_path)
    assert result.exit_code == 0 and "contours of 1 depth," in result.output
    record = read_rows(tmp_path / "s.contours.json")
    for row in (row for row in record["distances"] if row["surface"] == 1):
        assert row["mean_depth"] == pytest.approx(-0.2, abs=0.02)  # of triangles with other slopes
    reasons = {row["reason"] for row in record["areas"]}
    assert reasons == {"", "the other source has no contour of it"}


def test_contours_of_a_raster_lie_beside_those_of_the_true_bottom(run: Path, tmp_path: Path) -> None:
    """The grid of posts of the deck: its contours are those of the triangles, but for the posts' spacing."""
    (tmp_path / "s.csv").write_text(stage_readings.contours())
    means = []
    for bottom in (stage_readings.DECK, run.parent / "st_thomas_as11.BAY.tif"):
        words = ["as11", "compare-contours", str(run), str(bottom), str(tmp_path / "s.csv"), "--farthest", "60"]
        result = CliRunner().invoke(musat, words)
        assert result.exit_code == 0, result.output
        rows = read_rows(tmp_path / "s.contours.json")["distances"]
        means.append([row["mean"] for row in rows if row["depth"] == 10.0])
    np.testing.assert_allclose(means[1], means[0], rtol=0.3)  # the grid does not reach as far


def test_contours_without_a_partner_are_refused(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "s.csv"
    file.write_text("line,lat,lon,depth\n1,10,20,4\n1,10,20.1,4\n")
    result = compared(run, file, tmp_path)
    assert result.exit_code == 1 and "no contour has a partner" in result.output
    assert not (tmp_path / "s.contours.lst").exists()
