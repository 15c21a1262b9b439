"""How a problem is shown."""

from musatpy.errors import Problem, printable


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


def test_control_characters_are_escaped_and_keep_their_columns_in_a_card():
    problem = Problem(message="wrong \x1b[2J", file="a", columns=(2, 2), text="A\x9bB")
    assert printable(problem.render()).splitlines()[::2] == [r"a col 2: wrong \x1b[2J", "    A?B"]
    assert printable("a\tb\nc\xe9 \x7f\x85\u202e\udc80") == "a\tb\nc\xe9 " + r"\x7f\x85\u202e\udc80"
