"""How a problem is shown."""

from musatpy.errors import Problem, of_each_kind


def test_a_card_is_shown_with_ruler_and_carets():
    lines = Problem(message="wrong", file="a.crd", line=3, columns=(5, 7), text="TTL abc").render().splitlines()
    assert lines[0] == "a.crd:3 cols 5-7: wrong"
    assert lines[1] == "    " + "".join(f"----+----{i}" for i in range(1, 9))
    assert lines[2:] == ["    TTL abc", "        ^^^"]


def test_a_file_without_line_ends_is_not_shown_whole():
    text = "X" * 5000
    lines = Problem(message="too long", columns=(81, 5000), text=text).render().splitlines()
    assert lines[2] == "    " + "X" * 120 + "..."
    assert lines[3] == "    " + " " * 80 + "^" * 40
    assert len(Problem(message="far out", columns=(300, 310), text=text).render().splitlines()) == 3


def test_of_a_kind_a_hundred_are_printed_and_the_others_counted():
    far = [
        Problem(message=f"point {name} is {n} m off", card="PLT", severity="warning")
        for n, name in enumerate("ab" * 75)
    ]
    other = Problem(message="no sigma", card="PLT", severity="warning")
    shown = [one.headline() for one in of_each_kind([*far[:149], other, far[149]])]
    assert shown[:100] == [one.headline() for one in far[:100]]
    assert shown[100:] == [other.headline(), "PLT: warning: ... and 50 more of this kind"]


def test_problems_of_other_fields_are_of_another_kind():
    unread = [
        Problem(card="PLT", field=field, found="x", expected="F10.3") for field in ("x", "y") for _ in range(100)
    ]
    assert list(of_each_kind(unread)) == unread
