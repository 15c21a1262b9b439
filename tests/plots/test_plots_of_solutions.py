"""`musatpy.plots`: figures of a solution, as a notebook has them."""

import pickle

import pytest

import musatpy
from musatpy import adjust, read_deck
from musatpy.errors import MusatError
from musatpy.plots.gallery import GALLERY, rendered
from plots.plot_records import FIXTURES, st_thomas


@pytest.fixture(scope="module")
def solution() -> musatpy.Solution:
    return adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd"))


def test_every_picture_is_a_function_of_its_name() -> None:
    assert dir(musatpy.plots) == sorted(picture.name for picture in GALLERY)
    for picture in GALLERY:
        function = getattr(musatpy.plots, picture.name)
        assert function.__name__ == picture.name and picture.title.lower() in function.__doc__
    with pytest.raises(AttributeError, match="no attribute 'map'"):
        _ = musatpy.plots.map


def test_a_figure_of_a_solution_is_that_of_its_record(solution: musatpy.Solution) -> None:
    figure = musatpy.plots.plan(solution)
    assert "ST THOMAS" in figure.get_suptitle() and "101" in {text.get_text() for text in figure.axes[0].texts}
    shown = figure._repr_png_()  # by IPython, where pyplot has told it of no other way
    assert shown.startswith(b"\x89PNG") and pickle.loads(pickle.dumps(figure))._repr_png_() == shown
    (plan,) = (picture for picture in GALLERY if picture.name == "plan")
    drawn, of_record = plan.drawn(st_thomas()), rendered(plan, st_thomas())
    assert drawn is not None and of_record is not None
    assert [line.get_xydata().round(6).tolist() for line in drawn[0].axes[0].lines] == [
        line.get_xydata().round(6).tolist() for line in figure.axes[0].lines
    ]


def test_what_a_solution_has_not_is_said(solution: musatpy.Solution) -> None:
    with pytest.raises(MusatError, match="no gnss: no position of a station was observed"):
        musatpy.plots.gnss(solution)
