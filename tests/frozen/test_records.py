"""Records are held against one another by the names of their fields."""

from __future__ import annotations

import json

from frozen.records import differences


def text(**record):
    return json.dumps(record)


BEFORE = text(points={"id": ["1", "2"], "position": [[1.0, 2.0], [3.0, 4.0]]}, reasons=[{"text": "a"}])


def test_a_field_of_another_name_is_the_same_number_by_number():
    after = text(ground={"id": ["1", "2"], "place": [[1.0, 2.0], [3.0, 4.0]]}, reasons=[{"text": "a"}])
    names = {"points.id": "ground.id", "points.position": "ground.place"}
    assert differences(BEFORE, after, names) == []
    assert len(differences(BEFORE, after, {})) == 4


def test_a_number_that_moved_or_went_is_told():
    after = text(points={"id": ["1", "2"], "position": [[1.0, 2.0], [3.0, 4.5]]}, reasons=[])
    assert differences(BEFORE, after, {}) == [
        "only after: reasons",
        "only before: reasons.text",
        "points.position: 4 and 4 values; 4.0 -> 4.5",
    ]
