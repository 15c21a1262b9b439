"""`--dry` and `--submerged`: flags of points besides those of the cards."""

import json
import re
from pathlib import Path

import pytest

from cli.commands import musat

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECK = FIXTURES / "st_thomas/st_thomas.crd"
SUBMERGED = ["203", "206", "209", "210", "212", "218", "219", "ROCK"]  # by the flags of the deck
BELOW = ["203", "206", "210", "212", "218", "219"]  # those that stand below their water by more than 4 sigmas


@pytest.fixture
def deck(tmp_path):
    """Return a deck whose flags B were forgotten."""
    path = tmp_path / "job.crd"
    text = re.sub(r"(?m)^(PLT.{48,}?)B( +\d{8})$", r"\1 \2", DECK.read_text())
    path.write_text(text)
    assert not flagged(path)
    return path


def flagged(path, flag="B"):
    """Return the points that plate cards of a deck flag."""
    cards = [line for line in path.read_text().splitlines() if line.startswith("PLT") and line[61:62] == flag]
    return sorted({card[13:21].strip() for card in cards})


def record(deck):
    return json.loads(deck.with_suffix(".json").read_text())


def flagged_in(answer, field="bathymetric"):
    return sorted(name for name, flag in zip(answer["point"], answer[field], strict=True) if flag)


def square(around, half=0.0005):
    """Return the corners, in degrees, of a square around a longitude and a latitude."""
    east, north = around
    return [[east + x * half, north + y * half] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def polygon(path, corners):
    """Write corners to a file, a line each; return it."""
    path.write_text("".join(f"{first} {second}\n" for first, second in corners))
    return path


@pytest.fixture
def place(tmp_path_factory):
    """Return where points of the job are: longitude and latitude in degrees."""
    path = tmp_path_factory.mktemp("run") / "whole.crd"
    path.write_bytes(DECK.read_bytes())
    musat("run", path, "--record", "tables")
    points = record(path)["points"]
    turn = 57.29577951308232
    return {
        name: (xyz[1] * turn, xyz[0] * turn)
        for name, xyz in zip(points["point"], points["position"], strict=True)
        if xyz is not None and xyz[0] is not None
    }


@pytest.mark.slow
def test_a_list_flags_its_points_as_cards_would(deck, tmp_path):
    (tmp_path / "wet.txt").write_text("203, 206,209\n210 # reef\n\n212\n218,219,ROCK\n")
    result = musat("run", deck, "--submerged", tmp_path / "wet.txt")
    assert result.exit_code == 0
    said = record(deck)
    assert said.pop("settings") == ["submerged=wet.txt (8 points)"]
    listing = deck.with_suffix(".lst").read_text()
    assert f"{'Set for this run ':.<50} submerged=wet.txt (8 points)" in listing
    whole = tmp_path / "whole.crd"
    whole.write_bytes(DECK.read_bytes())
    musat("run", whole)
    assert said == record(whole)


def test_below_flags_what_stands_below_its_water_and_lists_what_is_undecided(deck):
    result = musat("run", deck, "--submerged", "BELOW")
    assert result.exit_code == 0 and "BELOW: undecided" in result.stderr
    answer = record(deck)
    assert flagged_in(answer["points"]) == BELOW
    assert answer["settings"] == ["submerged=BELOW (6 points)", "undecided: ROCK 209"]
    assert "submerged=BELOW (6 points), undecided: ROCK 209" in deck.with_suffix(".lst").read_text()
    assert answer["verdict"]["grade"] == "ACCEPTED"


@pytest.mark.slow
def test_below_with_the_tides_the_other_way_flags_nothing_and_needs_tides(deck):
    text = deck.read_text()
    deck.write_text(re.sub(r"(?m)^(TID.{10}).{9}", r"\1 -99.0000", text))
    result = musat("run", deck, "--submerged", "BELOW")
    assert result.exit_code == 0 and record(deck)["settings"] == ["submerged=BELOW (0 points)"]
    deck.with_suffix(".lst").unlink()
    deck.write_text("".join(line for line in text.splitlines(True) if not line.startswith("TID")))
    result = musat("run", deck, "--submerged", "BELOW")
    assert result.exit_code == 1 and "BELOW: no tide says how high the water stands" in result.stderr
    assert not deck.with_suffix(".lst").exists()


@pytest.mark.slow
def test_below_asks_the_first_adjustment_with_known_water(deck):
    """A level that is unknown is no unknown where nothing is submerged yet."""
    settings = ("--set", "OPT.program=IIIA", "--set", "OP2.water_level=ONE")
    assert musat("run", deck, *settings, "--submerged", "BELOW").exit_code == 0
    assert flagged_in(record(deck)["points"]) == BELOW


@pytest.mark.parametrize("ending", ["csv", pytest.param("geojson", marks=pytest.mark.slow)])
def test_polygons_hold_points_by_their_card_or_a_first_adjustment(deck, tmp_path, place, ending):
    """209 has no control card: its place is that of the first adjustment."""
    corners = square(place["209"])
    path = tmp_path / f"lagoon.{ending}"
    path.write_text(
        "".join(f"{east:.9f},{north:.9f}\n" for east, north in corners)
        if ending == "csv"
        else json.dumps({"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [corners]}})
    )
    assert musat("run", deck, "--submerged", path).exit_code == 0
    assert flagged_in(record(deck)["points"]) == ["209"]


def test_a_hole_of_a_polygon_is_outside(deck, tmp_path, place):
    geometry = {"type": "Polygon", "coordinates": [square(place["209"], 1.0), square(place["209"])]}
    path = tmp_path / "around.geojson"
    path.write_text(
        json.dumps({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": geometry}]})
    )
    musat("run", deck, "--dry", path)
    dry = flagged_in(record(deck)["points"], "dry")
    assert "209" not in dry and "101" in dry and "203" in dry


@pytest.mark.slow
def test_dry_points_are_in_no_doubt(deck, tmp_path, place):
    """218 lies below the water: with --dry it stands behind a dike."""
    path = polygon(tmp_path / "polder.csv", square(place["218"]))
    doubted = musat("run", deck)
    assert re.search(r"doubtful: .*\b218\b.* not flagged as submerged", doubted.stderr)
    result = musat("run", deck, "--dry", path)
    assert result.exit_code == 0 and not re.search(r"doubtful: .*\b218\b", result.stderr)
    assert record(deck)["settings"] == ["dry=polder.csv (1 point)"]
    assert flagged_in(record(deck)["points"], "dry") == ["218"]
    assert re.search(r"Points flagged D, dry for certain \.+ 1\n", deck.with_suffix(".lst").read_text())
    musat("run", deck, "--dry", path, "--submerged", "BELOW")
    assert flagged_in(record(deck)["points"]) == [name for name in BELOW if name != "218"]


def test_a_point_is_not_both_and_corners_of_latitude_and_longitude_hold_none(deck, tmp_path, place):
    path = polygon(tmp_path / "polder.csv", square(place["218"]))
    message = "point 218 would be flagged as submerged and as dry for certain"
    assert message in musat("run", deck, "--dry", path, "--submerged", path).stderr
    deck.write_bytes(DECK.read_bytes())
    turned = polygon(tmp_path / "turned.csv", [corner[::-1] for corner in square(place["218"])])
    none = "turned.csv: no point of the deck is in the polygon: its corners are longitude and"
    for corners, reason in ((path, message), (turned, none)):
        result = musat("run", deck, "--dry", corners)
        assert result.exit_code == 1 and reason in result.stderr


@pytest.mark.parametrize(
    ("text", "messages"),
    [("203\n2O6, 999\n", ["no point 2O6 in the deck", "no point 999 in the deck"]),
     ("# none yet\n", ["no point is named"]), (None, ["wet.txt: No such file"])],
)  # fmt: skip
def test_points_that_there_are_not_are_named(deck, tmp_path, text, messages):
    if text is not None:
        (tmp_path / "wet.txt").write_text(text)
    result = musat("run", deck, "--submerged", tmp_path / "wet.txt")
    assert result.exit_code == 1 and all(message in result.stderr for message in messages)
    result = musat("convert", "--submerged", tmp_path / "wet.txt", deck, tmp_path / "again.crd")
    assert (result.exit_code, (tmp_path / "again.crd").exists()) == (1, False)


@pytest.mark.parametrize(
    "text",
    [
        "{", '{"type": "Point", "coordinates": [1, 2]}', '{"type": "Polygon", "coordinates": [[[1, 2], [2, 2]]]}',
        '{"type": "Polygon", "coordinates": []}', '{"type": "Polygon", "coordinates": [[[1], [2], [3]]]}',
        '{"type": "Polygon", "coordinates": [[["x", 1], [2, 2], [3, 3]]]}', "[" * 99999, '{"a":' * 99999,
        '{"type": "FeatureCollection", "features": []}', '{"type": "Feature", "geometry": null}', "1 2\n3 x\n", "",
        '{"type": "Polygon", "coordinates": [[[1e400, 1], [2, 2], [3, 3]]]}', '{"type": ["Polygon"]}',
    ],
)  # fmt: skip
def test_what_is_no_polygon_is_refused(deck, tmp_path, text):
    path = tmp_path / "area.json"
    path.write_text(text)
    result = musat("run", deck, "--dry", path)
    assert result.exit_code == 1 and "unexpected" not in result.stderr and "area.json" in result.stderr


@pytest.mark.slow
def test_convert_writes_flags_on_the_plate_cards(deck, tmp_path):
    (tmp_path / "patb").mkdir()
    assert musat("convert", deck, tmp_path / "patb/job.im").exit_code == 0
    back = tmp_path / "back.crd"
    result = musat("convert", "--deck", deck, "--submerged", "BELOW", tmp_path / "patb", back)
    assert result.exit_code == 0 and "undecided" in result.stderr and "submerged=BELOW (6 points)" in result.stdout
    assert flagged(back) == BELOW
    (tmp_path / "wet.txt").write_text("\n".join(SUBMERGED))
    result = musat("convert", "--deck", deck, "--submerged", tmp_path / "wet.txt", tmp_path / "patb", back)
    assert result.exit_code == 0 and flagged(back) == SUBMERGED
    assert len(re.findall(r"(?m)^PLT .*B +\d{8}$", back.read_text())) == len(
        re.findall(r"(?m)^PLT .*B +\d{8}$", DECK.read_text())
    )


@pytest.mark.slow
def test_a_manifest_says_them_and_its_jobs_are_run_again_where_files_change(deck, tmp_path):
    wet, manifest = tmp_path / "wet.txt", tmp_path / "jobs.toml"
    for points, source, expected in (("203\n", "wet.txt", ["203"]), ("203,206\n", "wet.txt", ["203", "206"]),
                                     ("", "BELOW", BELOW)):  # fmt: skip
        wet.write_text(points)
        manifest.write_text(f'[[job]]\ndeck = "job.crd"\nsubmerged = "{source}"\n')
        assert musat("batch", "-q", "-j", 1, manifest).exit_code == 0
        assert flagged_in(record(deck)["points"]) == expected
    manifest.write_text('[[job]]\ndeck = "job.crd"\ndry = ["x"]\n')
    result = musat("batch", "-q", "-j", 1, manifest)
    assert result.exit_code == 1 and "jobs.toml" in result.stderr and "unexpected" not in result.stderr


def test_extract_takes_photos_in_geojson(tmp_path):
    path = tmp_path / "bay.geojson"
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": [[square((-64.92, 18.34), 1.0)]]}))
    result = musat("extract", DECK, "--area", path, "-o", tmp_path / "part.crd")
    assert result.exit_code == 0 and "3 photos" in result.stdout
