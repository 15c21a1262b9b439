"""The commands on a run whose cameras look at the horizon, up and down, one of them along X."""

from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from monuments import monument
from musatpy import read_deck, write_deck


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with deck, record and punched result of such a run: photo R03 looks along X."""
    out = tmp_path_factory.mktemp("monument")
    z, side = monument(1, photos=16, points=150, control=8).M[3, 2], np.array([0.3, 0.2, 0.9])
    side = np.cross(z, side) / np.linalg.norm(np.cross(z, side))
    A = np.stack([z, side, np.cross(z, side)])
    write_deck(monument(1, photos=16, points=150, control=8, turned=A).block, out / "tower.crd")
    run = musat("run", "-q", out / "tower.crd", "-o", out, "--punch", "result", "--punch-plates")
    assert run.exit_code == 0, run.output
    return out


def test_a_punched_result_is_a_deck_without_sigmas_of_what_is_only_known_together(folder: Path) -> None:
    photos = read_deck(folder / "tower.pun").photos
    assert np.isnan(photos.attitude_sigma[3]).tolist() == [True, False, True]
    assert np.isfinite(np.delete(photos.attitude_sigma, 3, axis=0)).all()


def test_the_listing_warns_and_leaves_these_sigmas_blank(folder: Path) -> None:
    text = (folder / "tower.lst").read_text(encoding="ascii")
    assert "photo R03: Y-tilt within a degree of 90" in text
    of_photo = [line.split() for line in text.splitlines() if line.startswith("R03 ")]
    assert [words[4] for words in of_photo if len(words) == 11] == ["89"]  # nine of the angles, one sigma


@pytest.mark.parametrize(
    "command", ["explain R03", "compare", "as11 setup", pytest.param("report", marks=pytest.mark.slow)]
)
def test_other_commands_take_the_run(folder: Path, command: str) -> None:
    record, models = folder / "tower.json", folder / "models.crd"
    models.write_text(f"TTL TOWER\n{'MDL R34      R03      R04':<59}5.00\nEND\n", encoding="ascii")
    more = {
        "compare": [record, record],
        "report": [record, "-o", folder / "page.html"],
        "as11 setup": [record, models, "-o", folder],
    }
    done = musat(*command.split(), *more.get(command, [record]))
    assert done.exit_code == 0, done.output


def test_a_dry_run_corrects_nothing(folder: Path) -> None:
    points = folder / "points.csv"
    points.write_text("x,y,z\n1,2,3\n", encoding="ascii")
    done = musat("correct", points, "--run", folder / "tower.json", "-o", folder / "true.csv")
    assert done.exit_code == 1 and "the run knows no water" in done.output
