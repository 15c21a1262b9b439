"""Order of rows: of what prints alike, of identifiers, of causes."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jobs.decks import cards, reread, rich
from musatpy import read_deck
from musatpy.formats.musat import deck_bytes
from musatpy.model import Cause, CauseKind, ObservationKind, Order, Solution
from musatpy.model.block import in_order_of_ids, natural_order
from musatpy.model.tables import falling, largest
from musatpy.reports import answer
from musatpy.reports.statistical_tests import OBSERVATIONS
from musatpy.runs import run_deck
from musatpy.statistics import Statistics
from sample_solutions import sample_solution

ROUNDING = 1e-13


@pytest.mark.parametrize("decimals", [None, 2])
@pytest.mark.parametrize("error", [-ROUNDING, 0.0, ROUNDING])
def test_rows_that_print_alike_keep_their_order(decimals: int | None, error: float) -> None:
    size = np.array([1.0, 3.55, 4.0, 3.55 + error, np.nan, np.inf, 0.0])
    assert falling(size, decimals).tolist() == [5, 2, 1, 3, 0, 6, 4]
    assert largest([0.5, 3.55, 3.55 + error, 1.0]) == 1
    assert falling([3.54, 3.56, 3.55], decimals).tolist() == [1, 2, 0]  # which do not
    assert falling([1.23456e-9, 1.23457e-9, -1e9]).tolist() == [1, 0, 2]  # of any size


@pytest.mark.parametrize("error", [-ROUNDING, ROUNDING])
def test_the_worst_observations_stand_in_the_same_order_with_other_rounding_errors(error: float) -> None:
    """Two images of the same residual, redundancy and sigma: which comes first must not depend on the kernels."""
    solution = sample_solution()
    observed = solution.observed
    assert observed is not None
    first, second = np.flatnonzero((observed.kind == ObservationKind.PLATE) & (observed.redundancy > 0.1))[:2]
    columns = {name: getattr(observed, name).copy() for name in ("residual", "redundancy", "sigma")}
    for column in columns.values():
        column[second] = column[first]
    orders = []
    for factor in (1.0, 1.0 + error):
        columns["residual"][second] = columns["residual"][first] * factor
        statistics = Statistics(replace(solution, observed=replace(observed, **columns)))
        orders.append(OBSERVATIONS.values(statistics).rows.tolist())
    assert orders[0] == orders[1]
    assert orders[0].index(first) < orders[0].index(second)


FIXTURES = Path(__file__).parents[2] / "fixtures"
# A station's cards and the members of a group may stand anywhere; titles are read in their order.
KEPT = ("TTL", "END")


def ordered(deck):
    """The cards of a fixture, its rows in the order of the identifiers."""
    block = read_deck(FIXTURES / deck)
    options = replace(block.options, order=Order.IDS)
    return deck_bytes(replace(block, options=options)).decode().splitlines()


def shuffled(deck, seed):
    """The cards in another order: titles first, the end last."""
    rest = [card[:72] for card in deck if not card.startswith(KEPT)]
    random.Random(seed).shuffle(rest)
    first, last = ([card for card in deck if card.startswith(kind)] for kind in KEPT)
    return [*first, *rest, *last]


def files(tmp_path, deck):
    (tmp_path / "job.crd").write_text("\n".join(deck) + "\n")
    result = run_deck(tmp_path / "job.crd")
    assert result.solution is not None, result.problems
    return result.listing.read_bytes(), result.record.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    "deck",
    [
        "st_thomas/st_thomas.crd",
        "st_thomas_raw/st_thomas_raw.crd",
        "cayman/cayman_modified.crd",
        "st_thomas_utm/st_thomas_utm.crd",
        "waves/strip.crd",
        "waves/unknown.crd",
    ],
)
def test_shuffled_cards_give_the_same_bytes(deck, tmp_path):
    given = ordered(deck)
    first = files(tmp_path, given)
    for seed in (1, 2):
        assert files(tmp_path, shuffled(given, seed)) == first


def test_ids_are_ordered_by_their_numbers():
    ids = ["10", "2", "P10", "P9", "A", "02", "P9B1", ""]
    assert [ids[row] for row in natural_order(ids)] == ["", "02", "2", "10", "A", "P9", "P9B1", "P10"]


def test_rows_keep_what_they_say():
    """Links are numbered anew with their rows: the cards are the same, but for the order of members of groups."""
    block = reread(rich())
    rows = in_order_of_ids(block)
    assert rows.points.ids.tolist() != block.points.ids.tolist()
    assert rows.points.ids.tolist() == sorted(block.points.ids.tolist(), key=lambda name: (len(name), name))

    def without_groups(of):
        return sorted(card for card in cards(of) if not card.startswith("EQL"))

    def members(of):
        groups = of.equal_elevations
        return sorted(zip(groups.ids[groups.group], of.points.ids[groups.point], strict=True))

    assert without_groups(rows) == without_groups(block)
    assert members(rows) == members(block)
    keys = list(zip(rows.plates.photo.tolist(), rows.plates.point.tolist(), strict=True))
    assert keys == sorted(keys)
    np.testing.assert_array_equal(in_order_of_ids(rows).plates.xy, rows.plates.xy)


@pytest.mark.parametrize(("drop", "said"), [(100.0, True), (np.nan, False)])
def test_causes_of_a_run_that_has_not_converged(drop: float, said: bool) -> None:
    cause = Cause(kind=CauseKind.TIDE, cards=("TID",), photos=("1",), drop=drop, advice="read it again")
    failed: Solution = replace(sample_solution(), converged=False, reason="it does not", causes=(cause,))
    lines = [line for section in answer.sections(Statistics(failed), lambda title: 0) for line in section.lines]
    assert any(answer.UNSETTLED[:40] in line for line in lines) is said
