"""The commands: what they print where, and the status they end with."""

import dataclasses
import os
import pty
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import musatpy
from cli.commands import musat
from musatpy.cli.main import COMMANDS
from musatpy.formats.musat import deck_bytes, read_deck

ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"
UNDERGROUND, IN_FEET = (
    ROOT / f"fixtures/verdict/{name}.crd" for name in ("cameras_underground", "control_in_feet")
)
MAIN = [sys.executable, "-c", "from musatpy.cli.main import main; main()"]


@pytest.fixture
def deck(tmp_path):
    return Path(shutil.copy(DECK, tmp_path / "job.crd"))


@pytest.fixture
def slow_deck(deck):
    """A deck that does not converge."""
    block = read_deck(deck)
    block = dataclasses.replace(block, options=dataclasses.replace(block.options, max_iterations=1, max_passes=1))
    deck.write_bytes(deck_bytes(block))
    return deck


@pytest.fixture
def bad_deck(deck):
    """A deck with two bad cards, and a photo that nothing says anything about."""
    lines = deck.read_text().splitlines(keepends=True)
    rows = [number for number, line in enumerate(lines) if line.startswith("PLT")]
    for row in rows[:2]:
        lines[row] = lines[row][:21] + "        1l.3" + lines[row][33:]
    deck.write_text("".join(lines))
    return deck


def test_run_says_on_one_line_what_came_of_it(deck):
    result = musat("run", deck)
    assert (result.exit_code, result.stderr) == (0, "")
    listing = deck.with_suffix(".lst")
    depths = r"sigma of depths \d\.\d{3} m \(median\), \d\.\d{3} m \(largest\), "
    pattern = rf"(.*): ACCEPTED, sigma0 \d\.\d{{4}}, {depths}(\d+) iterations, water passes: (\d+), listing (.*)\n"
    match = re.fullmatch(pattern, result.stdout)
    assert (match[1], match[4]) == (str(deck), str(listing))
    assert listing.exists() and listing.with_suffix(".json").exists()


@pytest.mark.parametrize(
    ("source", "options", "status", "stdout", "stderr"),
    [
        (DECK, ["-q"], 0, "", ""),
        (None, [], 3, ": FAILED, ", "not converged: "),
        (None, ["-q"], 3, "", "not converged: "),
        (
            UNDERGROUND,
            ["--causes", "none"],
            4,
            ": REJECTED, sigma0 26.7346",
            ": rejected: photos 1, 2, 3: the camera is below the ground",
        ),
        (DECK, ["--set", "OPT.plate_sigma=7.5"], 0, ": ACCEPTED, ", "note: sigma0 0.636 is below its 95 % limit"),
        pytest.param(IN_FEET, ["-q"], 0, "", "as if control were in feet", marks=pytest.mark.slow),
        pytest.param(IN_FEET, ["-q", "--strict"], 4, "", "doubtful: ", marks=pytest.mark.slow),
    ],
)
def test_a_run_ends_with_its_status_and_says_why(slow_deck, tmp_path, source, options, status, stdout, stderr):
    source = source or slow_deck
    result = musat("run", source, "-o", tmp_path / "out", *options)
    assert result.exit_code == status
    for text, part in ((result.stdout, stdout), (result.stderr, stderr)):
        assert part in text and bool(part) == bool(text)
    assert sorted(os.listdir(tmp_path / "out")) == [f"{source.stem}.json", f"{source.stem}.lst"]


def test_a_bad_deck_ends_with_1_and_every_reason_and_the_others_are_run(bad_deck, tmp_path):
    good = Path(shutil.copy(DECK, tmp_path / "good.crd"))
    result = musat("run", tmp_path / "missing.crd", bad_deck, good)
    assert result.exit_code == 1 and result.stdout.startswith(f"{good}: ") and result.stdout.count("\n") == 1
    assert result.stderr.count("'        1l.3'") + result.stderr.count("'1l.3'") == 2
    assert result.stderr.count("^") >= 2 * 12
    assert "job.crd: not run, 2 errors" in result.stderr and "missing.crd: No such file" in result.stderr
    assert good.with_suffix(".lst").exists() and not bad_deck.with_suffix(".lst").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("bad", "status"), [(False, 3), (True, 1)])
def test_of_several_decks_1_comes_before_3_before_4(slow_deck, tmp_path, bad, status):
    decks = [UNDERGROUND, slow_deck, *([tmp_path / "missing.crd"] if bad else [])]
    assert musat("run", "-q", "--causes", "none", *decks, "-o", tmp_path / "out").exit_code == status


def test_options_of_the_listing(deck, tmp_path):
    musat("run", deck, "-o", tmp_path / "whole", "--carriage-control", "--date")
    musat("run", deck, "-o", tmp_path / "brief", "--brief")
    whole, brief = ((tmp_path / name / "job.lst").read_text() for name in ("whole", "brief"))
    assert {line[0] for line in whole.splitlines()} <= set("1 0-")
    assert re.search(r"\d{4}-\d\d-\d\d  PAGE", whole.splitlines()[0])
    for title in ("Residuals Of Plate Measurements", "Input: Control"):
        assert title in whole and title not in brief
    assert "Depths Of Bathymetric Points" in brief


def test_a_missing_deck_a_folder_and_bytes_that_are_no_text_are_problems(tmp_path):
    binary = tmp_path / "binary.crd"
    binary.write_bytes(bytes(range(256)) * 10)
    for path in (tmp_path / "missing.crd", tmp_path, binary):
        for command in ("run", "check"):
            result = musat(command, path)
            assert (result.exit_code, type(result.exception)) == (1, SystemExit)
            assert str(path) in result.output and result.output.replace("\n", "").isprintable()


def test_results_that_cannot_be_written_end_in_one_line_per_deck(deck, tmp_path):
    good = Path(shutil.copy(DECK, tmp_path / "good.crd"))
    deck.with_suffix(".lst").mkdir()
    result = musat("run", deck, good)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert "job.lst" in line and good.with_suffix(".lst").is_file()
    (tmp_path / "file").write_text("")
    assert musat("run", deck, "-o", tmp_path / "file" / "results").exit_code == 1


def test_the_bad_card_of_the_manual(tmp_path, monkeypatch):
    manual = (ROOT / "docs" / "exit_statuses.md").read_text()
    example = re.search(r"(?m)^    deck\.crd:(\d+) .*\n(?:    .*\n)+", manual)
    text = "".join(line[4:] + "\n" for line in example[0].splitlines())
    lines = DECK.read_text().splitlines()
    lines[int(example[1]) - 1] = text.splitlines()[2][4:]
    (tmp_path / "deck.crd").write_text("\n".join(lines) + "\n")
    monkeypatch.chdir(tmp_path)
    assert musat("check", "deck.crd").stdout == text + "deck.crd: 1 error, 0 warnings\n"


@pytest.mark.parametrize("command", ["check", "run"])
def test_of_a_kind_three_problems_are_printed_and_the_lines_of_the_others(command, deck):
    cards = deck.read_text().splitlines(keepends=True)
    row = next(number for number, card in enumerate(cards) if card.startswith("PLT"))
    bad = [cards[row][:13] + f"X{n:<7}" + cards[row][21:24] + "x" + cards[row][25:] for n in range(1320)]
    deck.write_text("".join([*cards[:row], *bad, *cards[row:]]))
    output = musat(command, deck).output
    assert output.count("is not F12.7") == 3
    assert f"PLT.x: ... and 1,317 more of this kind, on lines {row + 4}-{row + 1320}\n" in output


def test_reasons_and_notes_of_a_run_are_no_more_than_a_hundred_of_a_kind(deck, monkeypatch):
    texts = [f"point {n} is odd" for n in range(130)]
    monkeypatch.setattr("musatpy.statistics.verdict.notes", lambda _: iter(texts))
    said = musat("run", deck).stderr
    assert said.count(": note: point ") == 100 and "note: ... and 30 more" not in said
    assert "job.crd: ... and 30 more of this kind" in said


def test_card_formats_that_are_wrong_end_in_one_line(tmp_path):
    (tmp_path / "broken.toml").write_text("this is not TOML")
    for command in ("check", "run"):
        result = musat(command, DECK, "--formats", tmp_path)
        assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (1, "", 1)
        assert "broken.toml" in result.stderr


def test_simulate_writes_the_same_deck_and_truth_every_time(tmp_path):
    spec = DECK.with_suffix(".toml")
    result = musat("simulate", spec, "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert result.stdout == f"{tmp_path}/st_thomas.crd: 3 photos, truth {tmp_path}/st_thomas.truth.json\n"
    assert (tmp_path / "st_thomas.crd").read_bytes() == DECK.read_bytes()
    assert (tmp_path / "st_thomas.truth.json").read_bytes() == DECK.with_suffix(".truth.json").read_bytes()
    musat("simulate", spec, "-o", tmp_path, "--seed", "77")
    assert (tmp_path / "st_thomas.crd").read_bytes() != DECK.read_bytes()


SEA = """
title = "SWELL"
[stereo]
cameras = [[0.0, 0.0, 490.0], [264.0, 0.0, 490.0]]
[water]
depth = 10.0
[[wave]]
period = 10.0
deep_height = 0.1
[area]
first = [0.0, -300.0]
spacing = [100.0, 100.0]
numbers = [4, 7]
"""


def test_waves_writes_report_and_points_and_says_whether_the_accuracy_is_kept(tmp_path):
    spec = tmp_path / "swell.toml"
    for height, says in (("1.5", "exceeded"), ("0.1", "kept")):
        spec.write_text(SEA.replace("0.1", height))
        result = musat("waves", spec, "-o", tmp_path / "out")
        assert (result.exit_code, result.output.rstrip().endswith(f"accuracy {says}")) == (0, True)
    assert sorted(os.listdir(tmp_path / "out")) == ["swell.waves.csv", "swell.waves.txt"]
    assert (tmp_path / "out" / "swell.waves.txt").read_text().startswith("SWELL\n")
    assert musat("waves", spec).exit_code == 0
    for name in ("swell.waves.csv", "swell.waves.txt"):
        assert (tmp_path / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    (tmp_path / "swell.waves.txt").unlink()
    (tmp_path / "swell.waves.txt").symlink_to(spec)
    assert "the result would overwrite" in musat("waves", spec).output and spec.read_text() == SEA


@pytest.mark.slow
def test_pictures_of_waves_are_written_on_request(tmp_path):
    (tmp_path / "swell.toml").write_text(SEA + "[study]\ndepths = [5, 10]\n")
    assert musat("waves", tmp_path / "swell.toml", "--plots").exit_code == 0
    for name in ("map", "histogram", "dependence"):
        assert (tmp_path / f"swell.{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("command", "text", "messages"),
    [
        ("simulate", "[flight]\nphotos = 0\nnonsense = 1\n", ["flight.photos", "flight.nonsense: is no key here"]),
        ("waves", SEA.replace("depth", "deep"), ["water.depth: is missing", "water.deep: is no key here"]),
    ],
)
def test_all_that_is_wrong_with_a_spec_is_told(tmp_path, command, text, messages):
    spec = tmp_path / "bad.toml"
    spec.write_text(text)
    result = musat(command, spec)
    assert result.exit_code == 1 and all(message in result.stderr for message in messages)
    assert os.listdir(tmp_path) == ["bad.toml"]
    assert musat(command, tmp_path / "missing.toml").exit_code == 1


def test_an_unexpected_error_is_one_line_that_asks_for_a_report(deck, monkeypatch):
    def fail(*arguments, **options):
        raise TypeError("no such\noperand")

    monkeypatch.setattr("musatpy.runs.adjust", fail)
    result = musat("run", deck)
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (1, "", 1)
    assert "TypeError: no such operand; please report it" in result.stderr
    assert isinstance(musat("--debug", "run", deck).exception, TypeError)


@pytest.mark.slow
def test_warnings_of_an_unchanged_deck_are_counted_and_printed_again_where_that_is_asked(tmp_path):
    deck = Path(shutil.copy(ROOT / "fixtures/verdict/iia_same_deck.crd", tmp_path))
    first = musat("run", deck)
    assert "cols 45-57 CTX.z: warning: point 144" in first.stderr
    again, asked = musat("run", deck), musat("run", deck, "--warnings")
    line = f"musat: {deck}: 1 warning of the unchanged deck, as at its last run; --warnings prints them\n"
    assert line in again.stderr and "CTX.z" not in again.stderr
    assert again.stdout == first.stdout and asked.stderr == first.stderr
    assert again.stderr.replace(line, "") == first.stderr[first.stderr.index("musat: ") :]
    assert line not in musat("run", deck, "-q").stderr
    assert musat("run", deck, "--set", "OPT.max_passes=19").stderr.startswith(str(deck))
    deck.write_bytes(deck.read_bytes())
    os.utime(deck, (0, 0))  # as a checkout of an older deck may do it
    assert musat("run", deck).stderr == first.stderr


@pytest.mark.slow
def test_pages_of_many_records_are_made_at_once(deck, tmp_path):
    other = Path(shutil.copy(deck, tmp_path / "other.crd"))
    assert musat("run", "-q", deck, other).exit_code == 0
    records = [deck.with_suffix(".json"), other.with_suffix(".json")]
    ran = musat("report", *records, tmp_path / "none.json", "-o", tmp_path / "pages")
    assert ran.exit_code == 1 and "none.json: No such file" in ran.stderr
    assert sorted(path.name for path in (tmp_path / "pages").iterdir()) == ["job.html", "other.html"]
    assert ran.stdout.count(": page ") == 2
    musat("report", records[1], "-o", tmp_path / "alone.html")
    assert (tmp_path / "alone.html").read_bytes() == (tmp_path / "pages/other.html").read_bytes()
    for words, message in (
        ((*records, "--input", deck), "--input goes with one record"),
        ((records[0], records[0]), "pages of two records would have the same name"),
    ):
        wrong = musat("report", *words)
        assert wrong.exit_code == 2 and message in wrong.stderr


def test_version_and_help():
    assert musat("--version").stdout == f"musat, version {musatpy.__version__}\n"
    text = musat("--help").stdout
    assert all(name in text for name in COMMANDS)
    assert "..." not in text.split("Commands:")[1]  # every short help fits
    for name in COMMANDS:
        assert musat(name, "--help").exit_code == 0


def test_help_does_not_load_the_adjustment():
    code = (
        "import sys\nfrom musatpy.cli.main import main\n"
        "main(['--help'], standalone_mode=False)\n"
        "sys.exit(any(name in sys.modules for name in ('numpy', 'scipy', 'pyproj')))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


@pytest.mark.slow
def test_a_name_that_the_terminal_cannot_show_is_no_reason_to_fail(tmp_path):
    name = os.fsencode(tmp_path) + b"/stra\xdfe-\xc3\xa4.crd"  # Latin-1 beside UTF-8
    shutil.copy(os.fsencode(DECK), name)
    environment = {**os.environ, "PYTHONIOENCODING": "ascii:strict", "PYTHONUTF8": "0"}
    for subcommand, extra in ((b"run", b""), (b"check", b""), (b"check", b".missing")):
        done = subprocess.run([*MAIN, subcommand, name + extra], capture_output=True, env=environment, check=False)
        assert done.returncode == (1 if extra else 0), done.stderr
        assert b"Traceback" not in done.stderr and b"stra" in done.stdout


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_error(bad_deck):
    code = f"{sys.executable} -c 'from musatpy.cli.main import main; main()' check {bad_deck} | head -n 1"
    done = subprocess.run(["/bin/sh", "-c", code], capture_output=True, check=False)
    assert (done.stderr, done.stdout.count(b"\n")) == (b"", 1)


@pytest.mark.slow
@pytest.mark.parametrize("quiet", [False, True])
def test_progress_is_shown_on_a_terminal_and_taken_away(deck, quiet):
    terminal, its_end = pty.openpty()
    code = "import musatpy.cli.progress as line; line._PATIENCE = 0.0\nfrom musatpy.cli.main import main; main()"
    command = [sys.executable, "-c", code, "run", str(deck), *(["-q"] if quiet else [])]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=its_end, check=False)
    os.close(its_end)
    assert (done.returncode, bool(done.stdout)) == (0, not quiet)
    if quiet:
        with pytest.raises(OSError):  # the terminal was closed before anything came
            os.read(terminal, 100_000)
    else:
        steps = os.read(terminal, 100_000).decode().split("\r")
        assert re.fullmatch(r"(\.\.\.)?.*job\.crd: reading, 0:0\d", steps[1])
        assert steps[-2].strip() == steps[-1] == ""
    os.close(terminal)
