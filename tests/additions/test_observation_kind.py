"""A kind of observation is added from outside as docs/extending.md says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
DECK = Path(__file__).parents[2] / "fixtures" / "cayman" / "cayman_clean.crd"
TRIES = """
import json
import sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from musatpy.adjustment import kinds
from musatpy.adjustment.kinds import state_after
from musatpy.adjustment.job import prepared
from musatpy.adjustment.network import job_frame
from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import extracted
from musatpy.jobs.merge import MergeOptions, merged
from musatpy.model import CauseKind, Editing, ObservationKind, PointStatus, Program, Refraction
from musatpy.formats import musat
from harbour_ranges import Ranges
from musatpy.reports.record import record
import musatpy

K = ObservationKind["RANGE"]
block = musatpy.read_deck(Path(sys.argv[1]))
block = replace(block, options=replace(block.options, program=Program.IIIA, refraction=Refraction.RIGOROUS))
without = musatpy.adjust(block)
count = 8
known = without.points.status == PointStatus.TRIANGULATED
taken = np.flatnonzero(block.plates.triangulated & known[block.plates.point])
chosen = taken[:: len(taken) // count][:count]
photo, point = block.plates.photo[chosen], block.plates.point[chosen]
frame = job_frame(block)
ends = [frame.working(of.position[row]) for of, row in ((without.stations, photo), (without.points, point))]
length = np.linalg.norm(ends[1] - ends[0], axis=1)
length += 0.3 * np.random.default_rng(5).normal(size=count)
sigma = np.full(count, 0.3)
block = replace(block, ranges=Ranges(photo=photo, point=point, length=length, sigma=sigma))

# its cards are written and read
cards = musat.deck_bytes(block)
block = musat.read_deck(cards)
assert sum(card.startswith(b"RNG ") for card in cards.splitlines()) == count and musat.deck_bytes(block) == cards
np.testing.assert_allclose(block.ranges.length, length, atol=6e-5)

# its rows go with their photos, and together again
first = np.arange(block.photos.count) < photo[count // 2]
parts = [Part(name=name, block=extracted(block, rows).block) for name, rows in (("a", first), ("b", ~first))]
assert [part.block.ranges.count for part in parts] == [np.count_nonzero(rows[photo]) for rows in (first, ~first)]
whole = merged([*parts, parts[1]], MergeOptions(join_photos=True)).block
assert sorted(whole.ranges.length) == sorted(block.ranges.length)
assert set(whole.photos.ids[whole.ranges.photo]) == set(block.photos.ids[photo])

# its partials are those of differences
job, state = prepared(block, None)
(kind,) = [each for each in kinds.MEASURED if each.observed is K]
rows = kind.rows(job.network, state)
assert rows.index.shape == (count, 6)
split = job.network.photos * job.network.pattern.size
for k in range(3):
    step = np.zeros(split + job.network.border.size)
    step[rows.index[:, k]] = 1e-3
    after = kind.rows(job.network, state_after(job.network, state, step)).residual
    # one station may have several ranges, and all its own partials are the same unknowns
    np.testing.assert_allclose((after - rows.residual) / 1e-3, rows.partials[:, k], atol=1e-5)

# it is adjusted, in the redundancy numbers, and counted
solution = musatpy.adjust(block)
observed = solution.observed
mine = observed.kind == K
assert solution.converged and mine.sum() == count and solution.observations["ranges"] == count
assert solution.degrees_of_freedom == without.degrees_of_freedom + count
assert abs(observed.redundancy.sum() - solution.degrees_of_freedom) < 1e-6
assert (observed.redundancy[mine] > 0.0).all() and np.abs(observed.residual[mine]).max() < 1.2
assert solution.stations.covariance[:, 2, 2].sum() < without.stations.covariance[:, 2, 2].sum()

# tested, searched, edited
length = length.copy()
length[3] += 20.0
wrong = replace(block, ranges=replace(block.ranges, length=length))
text = musatpy.listing(musatpy.adjust(wrong))
worst = text[text.index("Worst Observations"):]
name = f"{block.photos.ids[photo[3]]:<8} {block.points.ids[point[3]]}"
assert any(line.strip().startswith("range") and name in line for line in worst.splitlines()), worst[:2000]
edited = musatpy.adjust(replace(wrong, options=replace(block.options, editing=Editing.EDIT)))
(found,) = [one for one in edited.findings if one.kind is CauseKind["RANGE"]]
assert (found.photo, found.point) == (str(block.photos.ids[photo[3]]), str(block.points.ids[point[3]]))
assert abs(found.size[0] - 20.0) < 3.0 and len(edited.block.ranges.length) == count - 1
assert any(cause.kind == "range" and cause.cards == ("RNG",) for cause in edited.causes), edited.causes

# recorded
values = json.loads(json.dumps(record(solution)))
assert values["observations"]["kind"].count("range") == count
"""


@pytest.fixture(scope="module")
def ranges(tmp_path_factory, blocks) -> Path:
    """Return a folder with the package of the manual, and the name that makes it known."""
    folder = tmp_path_factory.mktemp("outside")
    names = ("__init__.py", "adjusted.py", "cards/rng.toml")
    for name, (_, text) in zip(names, blocks("A kind of observation"), strict=True):
        (path := folder / "harbour_ranges" / name).parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def python(folder: Path, *arguments: object, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run Python beside a package."""
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=os.environ | {"PYTHONPATH": path} | variables, capture_output=True, text=True
    )


def test_the_recipe_of_the_manual_works(ranges: Path) -> None:
    (ranges / "tries.py").write_text(f"import musatpy\nmusatpy.extend('harbour_ranges')\n{TRIES}", encoding="utf-8")
    ran = python(ranges, "tries.py", DECK)
    assert ran.returncode == 0, ran.stderr


def test_commands_know_it_by_the_variable(ranges: Path) -> None:
    card = b"RNG 999      1223        1612.4310   0.0200\n"
    (deck := ranges / "ranges.crd").write_bytes(DECK.read_bytes().replace(b"END  ", card + b"END  "))
    known = python(ranges, "-m", "musatpy", "check", deck, MUSATPY_EXTENSIONS="harbour_ranges")
    assert known.returncode == 1 and "999" in known.stdout, known.stdout
    unknown = python(ranges, "-m", "musatpy", "check", deck)
    assert unknown.returncode == 1 and "'RNG'" in unknown.stdout, unknown.stdout


@pytest.mark.parametrize(
    ("module", "expected"),
    [("harbour_depths", "harbour_depths cannot be imported"), ("json", "json does not state OBSERVATIONS, CAUSES")],
)
def test_a_module_that_is_none_ends_in_a_line(ranges: Path, module: str, expected: str) -> None:
    ran = python(ranges, "-m", "musatpy", "check", DECK, MUSATPY_EXTENSIONS=module)
    assert ran.returncode == 1 and expected in ran.stderr and "Traceback" not in ran.stderr


def test_an_extension_that_comes_too_late_is_refused(ranges: Path) -> None:
    late = "import musatpy\nmusatpy.read_deck\nmusatpy.extend('harbour_ranges')"
    assert "before anything else" in python(ranges, "-c", late).stderr
