"""Spoilt inputs end in an answer or a message: a few hundred of those that `fuzz_inputs` makes by the thousand."""

from __future__ import annotations

import pytest

from fuzz_inputs import fuzz


@pytest.mark.slow
def test_spoilt_inputs_end_in_an_answer_or_a_message() -> None:
    tally = fuzz(400, 7, tell=lambda text: None)
    assert tally.failures == []
    assert tally.statuses[0] > 40 and tally.statuses[1] > 40  # some are harmless, some are not
