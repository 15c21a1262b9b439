"""What `musat as11 compile` and `correct` say of their results: verdict, exit status, reasons."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from musatpy.cli.main import main as musat

TRUST = Path(__file__).parents[2] / "fixtures" / "trust"
MIRRORED = TRUST / "as11_mirrored.crd"  # plates mirrored in y


def invoked(*words: object) -> Result:
    return CliRunner().invoke(musat, [str(word) for word in words])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of a local job whose images are without errors."""
    folder = tmp_path_factory.mktemp("run")
    assert invoked("run", "-q", TRUST / "local_run.crd", "-o", folder).exit_code == 0
    return folder / "local_run.json"


def deck(path: Path, change: Callable[[str, list[float]], tuple[str, list[float]]]) -> Path:
    """Write the deck with its readings put right, y not mirrored, and then changed: point, plate coordinates."""
    lines = []
    for line in MIRRORED.read_text().splitlines():
        if line.startswith("STG"):
            xy = [float(line[first : first + 11]) for first in (24, 35, 46, 57)]
            head, xy = change(line[:24], [xy[0], -xy[1], xy[2], -xy[3]])
            line = head + "".join(f"{value:11.6f}" for value in xy) + line[68:]
        lines.append(line)
    path.write_text("\n".join(lines) + "\n")
    return path


def compiled(run: Path, path: Path, *options: str) -> tuple[Result, dict[str, object]]:
    result = invoked("as11", "compile", run, path, "-o", path.parent, *options)
    return result, json.loads(path.with_suffix(".json").read_text())["verdict"]


def moved(point: str, off: float) -> Callable[[str, list[float]], tuple[str, list[float]]]:
    """Return a change of the right y (mm) of one point."""

    def change(head: str, xy: list[float]) -> tuple[str, list[float]]:
        return head, [*xy[:3], xy[3] + (off if head[13:21].strip() == point else 0.0)]

    return change


def test_mirrored_plates_are_rejected(run: Path, tmp_path: Path) -> None:
    """All y-parallaxes of 1,500 sigmas ended with status 0."""
    path = tmp_path / "mirrored.crd"
    path.write_bytes(MIRRORED.read_bytes())
    result, verdict = compiled(run, path)
    assert result.exit_code == 4 and "mirrored.crd: REJECTED, 30 points in 1 model, listing" in result.stdout
    assert "mirrored.crd: rejected: model M: half of its y-parallaxes are beyond 1438.3 sigmas" in result.stderr
    assert verdict["grade"] == "REJECTED" and verdict["reasons"][0]["concern"] == "single observations"
    listing = path.with_suffix(".lst").read_text()
    assert "*** REJECTED ***" in listing.splitlines()[0] and "REJECTED: not to be used\n- model M: half" in listing


def test_plates_that_are_right_are_accepted(run: Path, tmp_path: Path) -> None:
    result, verdict = compiled(run, deck(tmp_path / "right.crd", moved("", 0.0)))
    assert (result.exit_code, verdict) == (0, {"grade": "ACCEPTED", "reasons": [], "notes": []})
    assert "right.crd: ACCEPTED, 30 points in 1 model" in result.stdout and not result.stderr


@pytest.mark.parametrize("off", [-0.1, 0.1])
def test_one_slip_in_y_is_a_doubt(run: Path, tmp_path: Path, off: float) -> None:
    """Of either sign; one reading of 14 sigmas spoils its own point alone."""
    path = deck(tmp_path / "slip.crd", moved("G5", off))
    result, verdict = compiled(run, path)
    assert (result.exit_code, verdict["grade"]) == (0, "DOUBTFUL")
    said = r"doubtful: 1 y-parallax beyond the test \(limit 3.6\): point G5 of model M by 1\d\.\d sigmas"
    assert re.search(said, result.stderr)
    assert compiled(run, path, "--strict")[0].exit_code == 4
    pair = invoked("diff", path.with_suffix(".lst"), path.with_suffix(".json"))
    assert pair.exit_code == 0, pair.output


def test_a_y_parallax_below_the_limit_of_all_together_is_no_doubt(run: Path, tmp_path: Path) -> None:
    _, verdict = compiled(run, deck(tmp_path / "small.crd", moved("G5", 0.02)))
    assert verdict["grade"] == "ACCEPTED"


def test_points_on_the_other_side_of_the_water_are_doubts(run: Path, tmp_path: Path) -> None:
    """An x-parallax of 1.5 mm raises G1 by some metres, above the water; G2 has lost its flag."""

    def change(head: str, xy: list[float]) -> tuple[str, list[float]]:
        point = head[13:21].strip()
        head = head.replace("GB", "G ") if point == "G2" else head
        return head, [*xy[:2], xy[2] - (1.5 if point == "G1" else 0.0), xy[3]]

    result, verdict = compiled(run, deck(tmp_path / "sides.crd", change))
    texts = [reason["text"] for reason in verdict["reasons"]]
    assert result.exit_code == 0 and len(texts) == 2, texts
    assert texts[0].startswith("1 point flagged as submerged, above the water: point G1 of model M by")
    assert texts[1].startswith("1 point not flagged as submerged, below the water: point G2 of model M by")


def test_where_nothing_is_compiled_the_status_is_not_0(run: Path, tmp_path: Path) -> None:
    """Without a tide no reading of a submerged point makes one."""
    record = json.loads(run.read_text())
    record["adjusted_water"]["tide"] = [None] * 3
    (tmp_path / "run.json").write_text(json.dumps(record))
    path = deck(tmp_path / "none.crd", moved("", 0.0))
    result = invoked("as11", "compile", tmp_path / "run.json", path, "-o", tmp_path)
    assert result.exit_code == 4, result.output
    assert "rejected: none of 30 readings makes a point: nothing is compiled (it is submerged" in result.stderr
    points = TRUST / "local_points.csv"
    result = invoked("as11", "correct", tmp_path / "run.json", "1", "2", points, "-o", tmp_path / "true.csv")
    assert result.exit_code == 4 and "rejected: nothing has a position: nothing is corrected" in result.stderr


def test_a_table_is_corrected_in_a_local_job(run: Path, tmp_path: Path) -> None:
    """It was refused: the run is a local job, and the file is in local."""
    result = invoked("as11", "correct", run, "1", "2", TRUST / "local_points.csv", "-o", tmp_path / "true.csv")
    assert result.exit_code == 0, result.output
    assert "true.csv: ACCEPTED, points: 2 of 2 with a position, 2 under water" in result.stdout
    assert "taken as local rectangular" in result.stdout
    # depths by the index at first: 3 and 4 m of apparent depth below the water
    heights = [float(line.split(",")[2]) for line in (tmp_path / "true.csv").read_text().splitlines()[1:]]
    assert heights == pytest.approx([-4.08, -5.47], abs=0.01)
    table = invoked("as11", "correct", run, "1", "2", TRUST / "local_points.csv", "-o", tmp_path / "true.xyz")
    assert table.exit_code == 0, table.output


def test_a_doubt_about_the_run_is_one_about_what_is_corrected(run: Path, tmp_path: Path) -> None:
    record = json.loads(run.read_text())
    record["verdict"] |= {
        "grade": "DOUBTFUL",
        "reasons": [{"grade": "DOUBTFUL", "concern": "sigma0", "text": "so", "section": ""}],
    }
    (tmp_path / "run.json").write_text(json.dumps(record))
    words = ("as11", "correct", tmp_path / "run.json", "1", "2", TRUST / "local_points.csv", "-o")
    result = invoked(*words, tmp_path / "true.csv")
    assert result.exit_code == 0 and "doubtful: the run is doubtful: so" in result.stderr
    assert "DOUBTFUL, points: 2 of 2" in result.stdout
    assert invoked(*words, tmp_path / "strict.csv", "--strict").exit_code == 4
