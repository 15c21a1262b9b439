"""`musat plot`, and `musat run --plots`: files, words, and what cannot be used."""

import json
import sys
from pathlib import Path

import pytest
from click.testing import Result

import stage_readings
from cli.commands import musat
from plots.plot_records import FIXTURES

DECK = FIXTURES / "st_thomas/st_thomas.crd"


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of the run of St. Thomas."""
    folder = tmp_path_factory.mktemp("run")
    assert musat("run", DECK, "-q", "-o", folder).exit_code == 0
    return folder / "st_thomas.json"


def plot(*words: object) -> Result:
    return musat("plot", *map(str, words))


def test_pictures_go_beside_the_record_and_say_what_they_show(record: Path, tmp_path: Path) -> None:
    result = plot(record, "-o", tmp_path, "--only", "tides", "--only", "corrections")
    assert result.exit_code == 0
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "st_thomas.corrections.svg",
        "st_thomas.tides.svg",
    ]
    assert "Refraction lowers 8 submerged points" in result.output
    assert plot(record, "--only", "tides", "-q").output == ""
    assert record.with_name("st_thomas.tides.svg").read_bytes() == (tmp_path / "st_thomas.tides.svg").read_bytes()


def width_of(png: bytes) -> int:
    """Return the width of an image, from its header."""
    return int.from_bytes(png[16:20], "big")


def test_pictures_have_the_format_and_the_dots_that_are_wanted(record: Path, tmp_path: Path) -> None:
    heads = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}
    for kind, head in heads.items():
        assert plot(record, "-o", tmp_path, "--only", "tides", "--format", kind).exit_code == 0
        assert (tmp_path / f"st_thomas.tides.{kind}").read_bytes().startswith(head)
    plain = (tmp_path / "st_thomas.tides.png").read_bytes()
    assert plot(record, "-o", tmp_path, "--only", "tides", "--format", "png", "--dpi", "220").exit_code == 0
    fine = (tmp_path / "st_thomas.tides.png").read_bytes()
    assert abs(width_of(fine) - 2 * width_of(plain)) <= 2
    assert plot(record, "--format", "gif").exit_code == 2 and plot(record, "--dpi", "5").exit_code == 2
    result = musat("run", DECK, "-o", tmp_path / "none", "--format", "pdf")
    assert result.exit_code == 2 and "--format and --dpi go with --plots" in result.output
    assert not (tmp_path / "none").exists()


def test_a_picture_of_depth_factors_has_the_dots_that_are_wanted(tmp_path: Path) -> None:
    pair, widths = ["--height", "2500", "--base", "1126", "--index", "1.34"], []
    for dpi in ("60", "120"):
        assert musat("depth", "picture", tmp_path / "f.png", *pair, "--dpi", dpi).exit_code == 0
        widths.append(width_of((tmp_path / "f.png").read_bytes()))
    assert abs(widths[1] - 2 * widths[0]) <= 2 and widths[0] > 240  # 4 inches and more


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "pictures"),
    [
        (["waves", FIXTURES / "waves/bay.toml", "--plots"], ["bay.dependence", "bay.histogram", "bay.map"]),
        (
            ["sea", "fit", FIXTURES / "sea/water.csv", "--model", "grid", "--spacing", "12", "--plots"],
            ["water.surface"],
        ),
        (
            ["orient", FIXTURES / "orientation/three_photos.crd", "--study"],
            ["three_photos.basins", "three_photos.correlations", "three_photos.precision"],
        ),
        (
            ["as11", "compile", "RECORD", stage_readings.DECK, "--plots"],
            [
                f"st_thomas_as11.{name}"
                for name in ("contours", "corrections", "depths", "parallaxes", "profile", "sigmas")
            ],
        ),
        (
            ["as11", "compare-soundings", "RECORD", stage_readings.DECK, stage_readings.SOUNDINGS, "--plots"],
            ["soundings.soundings"],
        ),
    ],
    ids=["waves", "sea", "orient", "compile", "soundings"],
)
def test_every_command_draws_in_the_format_that_is_wanted(
    record: Path, tmp_path: Path, words: list[object], pictures: list[str]
) -> None:
    words = [record if word == "RECORD" else word for word in words]
    assert musat(*words, "-o", tmp_path, "--format", "pdf").exit_code == 0
    assert sorted(file.stem for file in tmp_path.glob("*.pdf")) == pictures
    assert not [*tmp_path.glob("*.png"), *tmp_path.glob("*.svg")]
    assert musat(*words[:-1], "-o", tmp_path, "--dpi", "60").exit_code == 2


def test_what_cannot_be_drawn_has_a_reason(record: Path, tmp_path: Path) -> None:
    result = plot(record, "-o", tmp_path, "--only", "gnss")
    assert result.exit_code == 1 and not list(tmp_path.iterdir())
    assert "no gnss: no position of a station was observed" in result.output
    result = plot(record, "-o", tmp_path, "--only", "depths")
    assert result.exit_code == 1 and "no depths: is no picture of a run" in result.output


def test_the_list_names_every_picture() -> None:
    result = plot("--list")
    assert result.exit_code == 0
    for name in ("plan", "mean_residuals", "sigmas", "gnss", "parallaxes", "soundings"):
        assert f"  {name} " in result.output


def test_an_unknown_picture_is_a_wrong_command_line(record: Path) -> None:
    result = plot(record, "--only", "map")
    assert result.exit_code == 2 and "no picture 'map'; there are plan, residuals" in result.output


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not the record of a run, of a compilation or of a comparison"),
        ('{"schema_version": "3.0"}', "options: is missing"),
    ],
)
def test_what_is_no_record_is_refused(tmp_path: Path, text: str, said: str) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text(text)
    result = plot(bad)
    assert result.exit_code == 1 and said in result.output and "bad.json" in result.output
    assert plot(tmp_path / "none.json").exit_code == 1


def test_a_bad_record_keeps_no_other_from_its_pictures(record: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text("{}")
    result = plot(bad, record, "--only", "tides", "-o", tmp_path)
    assert result.exit_code == 1 and (tmp_path / "st_thomas.tides.svg").exists()


def test_two_records_of_one_name_in_one_folder_are_refused(record: Path, tmp_path: Path) -> None:
    other = tmp_path / record.name
    other.write_bytes(record.read_bytes())
    result = plot(record, other, "-o", tmp_path / "out")
    assert result.exit_code == 2 and "would both go to" in result.output


# --- lines and soundings of a profile ---


def profile(record: Path, folder: Path, text: str, *options: str, name: str = "line.csv") -> Result:
    line = folder / name
    line.write_text(text)
    return plot(record, "-o", folder, "--only", "profile", "--line", line, *options)


LINE = "lat,lon\n18.3353,-64.9440\n18.3285,-64.9290\n18.3285,-64.9150\n"


def test_a_profile_runs_along_a_line(record: Path, tmp_path: Path) -> None:
    result = profile(record, tmp_path, LINE)
    assert result.exit_code == 0 and "Along line.csv: " in result.output
    near = profile(record, tmp_path, LINE, "--within", "700")
    assert near.exit_code == 0 and "within 700 m" in near.output and near.output != result.output
    on_map = profile(
        record, tmp_path, "x,y\n294550,2027850\n297700,2028000\n", "--crs", "+proj=utm +zone=20 +ellps=clrk66"
    )
    assert on_map.exit_code == 0 and "submerged point" in on_map.output


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "line.csv:1: no columns lon, lat or x, y among a, b"),
        ("lat,lon\n18.3,x\n18.4,-64.9\n", "line.csv:2"),
        ("lat,lon\n18.3,-64.9\n", "a line needs two points"),
        ("x,y\n1,2\n3,4\n", "no coordinate system is given"),
        ("lat,lon\n18.1,-64.9\n18.1,-64.8\n", "no submerged point lies within"),
    ],
)
def test_a_line_that_cannot_be_used(record: Path, tmp_path: Path, text: str, said: str) -> None:
    result = profile(record, tmp_path, text)
    assert result.exit_code == 1 and said in result.output and "Traceback" not in result.output


def test_soundings_stand_beside_a_profile(record: Path, tmp_path: Path) -> None:
    soundings = tmp_path / "soundings.csv"
    soundings.write_text(stage_readings.soundings())
    result = plot(record, "-o", tmp_path, "--only", "profile", "--soundings", soundings, "--datum", "-0.15")
    assert result.exit_code == 0 and " soundings within " in result.output
    soundings.write_text("lat,lon,depth\n1,2,x\n")
    result = plot(record, "-o", tmp_path, "--only", "profile", "--soundings", soundings)
    assert result.exit_code == 1 and "soundings.csv:2" in result.output


# --- compilations ---


@pytest.mark.slow
def test_a_compilation_has_pictures_of_its_own(record: Path, tmp_path: Path) -> None:
    assert musat("as11", "compile", record, stage_readings.DECK, "-o", tmp_path).exit_code == 0
    result = plot(tmp_path / "st_thomas_as11.json")
    assert result.exit_code == 0
    for name in ("depths", "sigmas", "profile", "corrections", "parallaxes"):
        assert (tmp_path / f"st_thomas_as11.{name}.svg").read_text().startswith("<?xml")
    assert "below MLLW" in result.output
    job = json.loads((tmp_path / "st_thomas_as11.json").read_text())["job"]
    assert job["ellipsoid"] == {"name": "clrk66", "semi_major_axis": None, "inverse_flattening": None}
    words = ["--only", "profile", "--soundings", stage_readings.SOUNDINGS, "--datum", "-0.15"]
    result = plot(tmp_path / "st_thomas_as11.json", *words)
    assert result.exit_code == 0 and " soundings within " in result.output


# --- in one go, and without the package ---


@pytest.mark.slow
def test_a_run_draws_its_pictures(record: Path, tmp_path: Path) -> None:
    result = musat("run", DECK, "-o", tmp_path, "--plots", "--record", "none")
    assert result.exit_code == 0 and "9 pictures" in result.output
    assert "no gnss: no position of a station was observed" in result.output
    assert plot(record, "-q").exit_code == 0
    for file in tmp_path.glob("*.svg"):
        assert file.read_bytes() == record.with_name(file.name).read_bytes()
    musat("run", DECK, "-o", tmp_path, "--plots", "--format", "pdf", "--record", "none")
    assert len([*tmp_path.glob("*.pdf")]) == len([*tmp_path.glob("*.svg")]) == 9


def test_without_matplotlib_there_is_a_pip_line(
    record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    for words in (["plot", str(record), "-o", str(tmp_path)], ["run", str(DECK), "-o", str(tmp_path), "--plots"]):
        result = musat(*words)
        assert result.exit_code == 1 and "pip install 'musatpy[plots]'" in result.output
    assert not list(tmp_path.iterdir())  # nothing was adjusted
