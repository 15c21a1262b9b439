"""Files of BINGO and PAT-B with names of today's photos: into jobs as they are, into decks by short ones."""

import re

import numpy as np
import pytest

from formats.agency_blocks import deck_of, random_job
from musatpy.errors import DeckError
from musatpy.files import write_files
from musatpy.formats import families
from musatpy.formats.job_folder import read_job
from musatpy.formats.parts import deck_parts
from musatpy.formats.records.files import read_records
from musatpy.model import CoordinateSystem

FAMILIES = families.families()
PLACES = {"patb": "job.im", "bingo": "image.dat"}


def renamed(folder, names):
    """Give the words of the files in a folder that are names others, whatever their columns."""
    for path in folder.iterdir():
        lines = [
            re.sub(r"\S+", lambda word: names.get(word[0], word[0]), line) for line in path.read_text().split("\n")
        ]
        path.write_text("\n".join(lines))


@pytest.fixture
def files(tmp_path, request):
    """A folder of files with long names, these by the short ones, the deck that completes them, and its parts."""
    block, family = random_job(3, CoordinateSystem.LOCAL), FAMILIES[request.param]
    folder = tmp_path / "files"
    folder.mkdir()
    family.dump_one(block, folder / PLACES[request.param])
    given = deck_of(block, tmp_path)
    names = {name: f"nadir/102MEDIA/DJI_{n:04d}.JPG" for n, name in enumerate(block.photos.ids.tolist())}
    names |= {name: f"marker_{'x' * 100}_{name}" for name in block.points.ids.tolist()}
    before, _ = family.read(folder, musat_parts(given))
    renamed(folder, names)
    return family, folder, names, given, before


def musat_parts(deck):
    """Return what of a deck no file says."""
    return {role: table for role, table in deck_parts(deck).items() if role in ("options", "cameras")}


@pytest.mark.parametrize("files", PLACES, indirect=True)
def test_long_names_go_into_a_job_and_short_ones_into_a_deck(files, tmp_path):
    family, folder, names, given, before = files
    parts, _ = family.read(folder, musat_parts(given))
    for role, path in (("stations", "photos.ids"), ("plates", "plates.point"), ("control", "control.point")):
        assert parts[role][path].tolist() == [names[name] for name in before[role][path].tolist()]
    for role, path in (("stations", "photos.position"), ("attitudes", "photos.attitude"), ("plates", "plates.xy")):
        assert np.array_equal(parts[role][path], before[role][path])
    write_files(FAMILIES["job"].render(parts, tmp_path / "long.job", "long").contents)
    job = read_job(tmp_path / "long.job").tables
    for role in ("stations", "attitudes", "plates", "control"):
        for path, column in parts[role].items():
            assert np.array_equal(job[role][path], column, equal_nan=column.dtype.kind == "f")
    deck = FAMILIES["musat"].render(parts, tmp_path / "short.crd", "short").contents
    ids = deck[tmp_path / "short.ids.csv"].decode().splitlines()
    assert 'photos,0001,"nadir/102MEDIA/DJI_0001.JPG"' in ids
    cards = deck[tmp_path / "short.crd"].decode().splitlines()
    stations = [card[4:12].strip() for card in cards if card[:3] in ("STA", "STX", "STG")]
    assert stations == [name[-8:-4] for name in parts["stations"]["photos.ids"].tolist()]


@pytest.mark.parametrize("files", PLACES, indirect=True)
def test_a_name_of_more_than_128_letters_is_refused_with_its_line(files):
    family, folder, names, given, _ = files
    longest, too_long = "p" * 128, "p" * 129
    first = next(name for name in names.values() if name.startswith("marker"))
    renamed(folder, {first: longest})
    family.read(folder, musat_parts(given))
    renamed(folder, {longest: too_long})
    with pytest.raises(DeckError) as refused:
        family.read(folder, musat_parts(given))
    line = next(
        n for n, text in enumerate((folder / PLACES[family.name]).read_text().split("\n"), 1) if too_long in text
    )
    assert f"{PLACES[family.name]}:{line} " in str(refused.value)
    assert "is not a name of at most 128 letters" in str(refused.value)


@pytest.mark.parametrize("name", PLACES)
def test_plain_lines_of_large_files_read_as_any_others(name):
    """Of decimals and blanks only, which most lines are; another form of number goes through all rules."""
    spec = next(file for file in FAMILIES[name].files if file.leaves()[0].name == "point")
    rows = [(f"p{n}", 0.1 * n - 0.7, -3.0 / (n + 1)) for n in range(9)]
    plain = "".join(f" {point}  {x:.6f} {y:+.6f}\n" for point, x, y in rows)
    other = "".join(f" {point}  {x:.6f}E0 {y:+.6f}D0\n" for point, x, y in rows)
    read = [read_records(f"a\n{text}-99\nb\n{text}\n-99\n".encode(), spec, name) for text in (plain, other)]
    for of in read:
        assert not of.problems and of.lines["point"].tolist() == [*range(2, 11), *range(13, 22)]
    for field, column in read[0].tables["point"].items():
        assert np.array_equal(column, read[1].tables["point"][field])
    problems = []
    for text in (plain, other):
        wrong = text.replace(" p3 ", " -99 ").replace(" p5 ", " # ").replace("p7  0.", "p7  .0.")
        read = read_records(f"a\n{wrong}-99\n".encode(), spec, name)
        problems.append([(problem.line, problem.card, problem.severity) for problem in read.problems])
    assert problems[0] == problems[1] and any(severity == "error" for *_, severity in problems[0])
