"""What is blamed where nothing has converged is said with that reserve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.model import Cause, CauseKind, Solution
from musatpy.reports import answer
from musatpy.statistics import Statistics
from sample_solutions import sample_solution


@pytest.mark.parametrize(("drop", "said"), [(100.0, True), (np.nan, False)])
def test_causes_of_a_run_that_has_not_converged(drop: float, said: bool) -> None:
    cause = Cause(kind=CauseKind.TIDE, cards=("TID",), photos=("1",), drop=drop, advice="read it again")
    failed: Solution = replace(sample_solution(), converged=False, reason="it does not", causes=(cause,))
    lines = [line for section in answer.sections(Statistics(failed), lambda title: 0) for line in section.lines]
    assert any(answer.UNSETTLED[:40] in line for line in lines) is said
