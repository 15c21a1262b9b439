"""Spoilt inputs end in an answer or a message: two hundred of those that `fuzz_inputs` makes by the thousand."""

from __future__ import annotations

import pytest

from fuzz_inputs import fuzz


@pytest.mark.slow
def test_spoilt_inputs_end_in_an_answer_or_a_message() -> None:
    tally = fuzz(200, 7, tell=lambda text: None)
    assert tally.failures == []
    assert tally.statuses[0] > 20 and tally.statuses[1] > 20  # some are harmless, some are not
