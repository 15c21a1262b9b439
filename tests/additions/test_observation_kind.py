"""A kind of observation is added to a copy of the program as docs/extending.md says."""

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
from musatpy.model import CauseKind, Editing, ObservationKind, PointStatus, Program, Refraction
from musatpy.formats import musat
from musatpy.model.kinds import Ranges
from musatpy.reports.record import record
import musatpy

K = ObservationKind.RANGE
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
(found,) = [one for one in edited.findings if one.kind is CauseKind.RANGE]
assert (found.photo, found.point) == (str(block.photos.ids[photo[3]]), str(block.points.ids[point[3]]))
assert abs(found.size[0] - 20.0) < 3.0 and len(edited.block.ranges.length) == count - 1
assert any(cause.kind == "range" and cause.cards == ("RNG",) for cause in edited.causes), edited.causes

# recorded
values = json.loads(json.dumps(record(solution)))
assert values["observations"]["kind"].count("range") == count
"""


def test_the_recipe_of_the_manual_works(copy, blocks) -> None:
    table, kind, name, field, source, card = [text for _, text in blocks("A kind of observation")]
    kinds, block = "model/kinds.py", "model/block.py"
    copy.put(kinds, "_NOTHING = np.zeros(0, dtype=np.int64)", f"\n\n{table}", indent="")
    copy.put(kinds, "from __future__ import annotations", "from dataclasses import dataclass", indent="")
    imports = "from musatpy.arrays import FloatArray, IntArray\nfrom musatpy.model.tables import Table, per_row"
    copy.put(kinds, "import numpy as np", imports, indent="")
    wave = '    WAVE = 11, "waves", "wave", "", ("height", "length", "azim.", "crest"), "m,rd"  # AdjustedWaves'
    copy.put(kinds, wave, kind)
    copy.put("model/findings.py", '        "read the air base card again: photos and digits")', name)
    copy.put(block, "from __future__ import annotations", "from musatpy.model.kinds import Ranges", indent="")
    copy.put(block, "    air_bases: AirBases = field(default_factory=partial(empty, AirBases))", field)
    (copy.package / "adjustment" / "kinds" / "ranges.py").write_text(source, encoding="utf-8")
    (copy.package / "card_formats" / "musat" / "rng.toml").write_text(card, encoding="utf-8")
    copy.tries(TRIES, DECK)
