"""How a problem is shown."""

from musatpy.errors import Problem


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
