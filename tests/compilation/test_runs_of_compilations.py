"""What a compilation may stand on: a run that has not converged, said on every page, and punched decks."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stage_readings
from altered import altered
from cli.commands import musat
from compilation.scenes import readings_at
from musatpy import read_deck
from musatpy.as11_runs import run_of
from musatpy.compilation.loop import stages
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import AdjustedRun, of_block
from musatpy.compilation.true_points import Readings, true_points
from musatpy.model import Program, WaterLevel
from musatpy.reports.compilation import AGAINST_RUN
from record_rows import read_rows, valid_rows

DECK = stage_readings.FIXTURES / "st_thomas/st_thomas.crd"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a run and its punched result, a restart, and a run of a single iteration."""
    folder = tmp_path_factory.mktemp("runs")
    text = DECK.read_text().replace("FULL      20", "FULL       1")
    (folder / "halted.crd").write_text(text)
    assert musat("run", DECK, "-q", "-o", folder, "--punch", "result").exit_code == 0
    (folder / "st_thomas.pun").rename(folder / "result.pun")
    assert musat("run", DECK, "-q", "-o", folder, "--punch", "restart").exit_code == 0
    assert musat("run", folder / "halted.crd", "-q", "-o", folder).exit_code == 3
    return folder


def pages(listing: Path) -> list[str]:
    return listing.read_text().split("\f")


def points(folder: Path) -> dict[str, np.ndarray]:
    rows = read_rows(folder / "st_thomas_as11.json")["points"]
    return {name: np.array([row[name] or [np.nan] * 3 for row in rows]) for name in ("position", "sigma")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "more", "listing"),
    [
        ("compile", (), "st_thomas_as11.lst"),
        ("setup", (), "st_thomas_as11.setup.lst"),
        ("compare-points", (), "st_thomas_as11.points.lst"),
        ("compare-soundings", (stage_readings.SOUNDINGS,), "soundings.soundings.lst"),
    ],
)
def test_a_run_that_has_not_converged_is_said_on_every_page(
    runs: Path, tmp_path: Path, command: str, more: tuple[Path, ...], listing: str
) -> None:
    words = ("as11", command, runs / "halted.json", stage_readings.DECK, *more, "-o", tmp_path)
    refused = musat(*words)
    assert refused.exit_code == 1 and "the run has not converged: limits not reached" in refused.output
    assert not list(tmp_path.iterdir())
    assert musat(*words, "--anyway").exit_code == 0
    assert all(page.splitlines()[1] == "*** THE RUN HAS NOT CONVERGED ***" for page in pages(tmp_path / listing))


@pytest.mark.slow
@pytest.mark.parametrize("grade", ["DOUBTFUL", "REJECTED"])
def test_a_verdict_against_the_run_is_said_on_every_page(runs: Path, tmp_path: Path, grade: str) -> None:
    record = json.loads((runs / "st_thomas.json").read_bytes())
    assert record["verdict"]["grade"] == "ACCEPTED"
    reasons = [{"grade": grade, "concern": "sigma0", "text": text, "section": ""} for text in ("one", "another")]
    record["verdict"] |= {"grade": grade, "reasons": reasons}
    (tmp_path / "run.json").write_text(json.dumps(record))
    result = musat("as11", "compile", tmp_path / "run.json", stage_readings.DECK, "-o", tmp_path)
    assert result.exit_code == 0 and f"the run is {grade.lower()}: one; another\n" in result.output
    listing = pages(tmp_path / "st_thomas_as11.lst")
    assert all(page.splitlines()[1] == f"*** THE RUN IS {grade} ***" for page in listing)


@pytest.mark.slow
@pytest.mark.parametrize("punched", ["result.pun", "st_thomas.pun"])
def test_a_punched_deck_gives_the_points_of_its_run(runs: Path, tmp_path: Path, punched: str) -> None:
    """Cards have stations to .1 mm and 1e-4 arc seconds, which is 1 mm at 2,400 m. Sigmas: of the stages alone."""
    for name, run in (("run", "st_thomas.json"), ("deck", punched)):
        assert musat("as11", "compile", runs / run, stage_readings.DECK, "-o", tmp_path / name).exit_code == 0
    of_run, of_deck = points(tmp_path / "run"), points(tmp_path / "deck")
    gap = (of_deck["position"] - of_run["position"]) * [6.4e6, 6.4e6, 1.0]
    assert np.nanmax(np.abs(gap)) < 0.005
    assert np.nanmin(of_run["sigma"] / of_deck["sigma"]) > 1.0
    text = pages(tmp_path / "deck/st_thomas_as11.lst")
    assert all("SIGMAS ARE THOSE OF STAGES AND WATER ALONE" in page.splitlines()[1] for page in text)


def test_sigmas_from_a_punched_deck_are_those_of_the_pointing(runs: Path, tmp_path: Path) -> None:
    """B'B of four image coordinates of 5 um: here by differences of what both stages read of a moved mark."""
    run = run_of(runs / "result.pun")
    stereo = set_up(run, "21", "22")
    mark = np.array([[300.0, -900.0, -12.0]])
    steps = 0.01 * np.eye(3)
    B = np.stack([(stages(stereo, mark + s) - stages(stereo, mark - s)).ravel() / 0.02 for s in steps], axis=1)
    expected = np.sqrt(np.diagonal(np.linalg.inv(B.T @ B))) * 0.005
    covariance = true_points(run, stereo.photos, readings_at(stages(stereo, mark))).covariance[0]
    turned = stereo.axes @ run.frame.axes(stereo.working(mark))[0].T
    assert np.allclose(np.sqrt(np.diagonal(turned @ covariance @ turned.T)), expected, rtol=1e-5)


@pytest.mark.parametrize("level", [WaterLevel.ONE, WaterLevel.PHOTO])
def test_sigmas_on_the_water_cards_of_a_punched_deck_are_in_those_of_points(level: WaterLevel) -> None:
    """By what a point moves by when the tides and the index are others: together, or each tide by itself."""
    sigmas = {"photos": {"tide_sigma": np.full(3, 0.2)}, "water": {"sigma": 0.01}}
    block = altered(read_deck(DECK), **sigmas, options={"program": Program.IIIA, "water_level": level})
    run, reading = of_block(block), one_reading(of_block(block))

    def at(tides: list[float], index: float) -> np.ndarray:
        tide = run.block.photos.tide + np.array([*tides, 0.0])
        moved = altered(run, block={"photos": {"tide": tide}, "water": {"index": 1.34 + index}})
        return run.frame.working(true_points(moved, (0, 1), reading).position)[0]

    def by(tides: list[float], index: float) -> np.ndarray:
        return (at(tides, index) - at([-t for t in tides], -index)) / 2.0

    together = level is WaterLevel.ONE
    steps = [([0.2, 0.2], 0.0)] if together else [([0.2, 0.0], 0.0), ([0.0, 0.2], 0.0)]
    errors = np.stack([by(*step) for step in (*steps, ([0.0, 0.0], 0.01))])
    axes = run.frame.axes(at([0.0, 0.0], 0.0))
    found, exact = (true_points(of, (0, 1), reading).covariance[0] for of in (run, replace(run, water=None)))
    np.testing.assert_allclose(found - exact, axes @ errors.T @ errors @ axes.T, rtol=1e-3, atol=1e-6)
    assert found[2, 2] > 1.1 * exact[2, 2]


def one_reading(run: AdjustedRun) -> Readings:
    """Return the reading of a submerged point on the first two photos."""
    stereo = set_up(run, *run.block.photos.ids[:2].tolist())
    return readings_at(stages(stereo, np.array([[300.0, -900.0, -12.0]])))


@pytest.mark.parametrize(
    ("punched", "old", "new", "messages"),
    [
        ("result.pun", r"^ATT 22.*\n", "", ("22", "attitude")),
        ("st_thomas.pun", r"^PLT 21.*\n", "", ("MDL.right: model 2122: photos 21 and 22 share no point",)),
        # a tenth of a degree farther west, 10 km; from corner to corner they show some 5 km
        ("result.pun", r"^(STA 21.*)-64 56", r"\1-65  2", ("photos 21 and 22 do not overlap: 1199",)),
    ],
)
def test_decks_that_cannot_be_a_run_are_refused_with_their_reasons(
    runs: Path, tmp_path: Path, punched: str, old: str, new: str, messages: tuple[str, ...]
) -> None:
    text, count = re.subn(old, new, (runs / punched).read_text(), flags=re.MULTILINE)
    deck = tmp_path / "other.pun"
    deck.write_text(text)
    result = musat("as11", "compile", deck, stage_readings.DECK, "-o", tmp_path)
    assert count and result.exit_code == 1 and all(message in result.output for message in messages)
    assert "Traceback" not in result.output


@pytest.mark.parametrize("name", ["st_thomas/st_thomas", "cayman/cayman_clean", "st_thomas_raw/st_thomas_raw"])
def test_the_deck_of_a_run_that_is_still_to_be_adjusted_is_refused(name: str, tmp_path: Path) -> None:
    run = stage_readings.FIXTURES / f"{name}.crd"
    result = musat("as11", "compile", run, stage_readings.DECK, "-o", tmp_path)
    assert result.exit_code == 1 and not list(tmp_path.iterdir())
    assert f"{run}: its stations do not fit its plate measurements: of " in result.output
    assert "NAME.json" in result.output and "NAME.pun" in result.output


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("st_thomas_as11/st_thomas_as11.crd", "a compilation deck (MDL cards)"),
        ("st_thomas_as11/soundings.csv", "no deck with exposure stations (STA cards)"),
    ],
)
def test_what_is_no_run_is_told_in_a_line(name: str, what: str, tmp_path: Path) -> None:
    run = stage_readings.FIXTURES / name
    result = musat("as11", "setup", run, stage_readings.DECK, "-o", tmp_path)
    assert result.exit_code == 1
    assert result.output.splitlines()[0] == (
        f"{run}: it is {what}; expected the record of a run, NAME.json, or the deck that it punched, NAME.pun"
    )
    assert len(result.output.splitlines()) == 2


def test_it_is_compiled_from_all_the_same_when_asked_for(tmp_path: Path) -> None:
    result = musat("as11", "setup", DECK, stage_readings.DECK, "-o", tmp_path, "--anyway")
    assert result.exit_code == 0 and "model 2122 is not recovered" in result.output


def test_points_are_compared_with_those_of_the_run(runs: Path, tmp_path: Path) -> None:
    """The lengths are those of the differences; the record obeys its schema; the audit finds nothing."""
    result = musat("as11", "compare-points", runs / "st_thomas.json", stage_readings.DECK, "-o", tmp_path)
    assert result.exit_code == 0
    record = valid_rows(tmp_path / "st_thomas_as11.points.json", AGAINST_RUN.schema())
    lengths = np.linalg.norm([row["difference"] for row in record["against_run"]], axis=1)
    told = f"vectors {lengths.min():.4f} to {lengths.max():.4f} m, mean {lengths.mean():.4f} m"
    assert f"26 points of the run, {told}" in result.output
    assert musat("audit", tmp_path / "st_thomas_as11.points.lst").exit_code == 0


def test_points_without_a_partner_are_not_compared(runs: Path, tmp_path: Path) -> None:
    deck = tmp_path / "other.crd"
    lines = [line for line in stage_readings.DECK.read_text().splitlines() if line[:3] not in ("PRF", "GRD")]
    deck.write_text("\n".join(line for line in lines if line[:3] != "STG" or " G0" in line) + "\n")
    result = musat("as11", "compare-points", runs / "st_thomas.json", deck, "-o", tmp_path)
    assert result.exit_code == 1 and "no point of it has a position in the run too" in result.output
