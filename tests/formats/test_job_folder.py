"""Job folders: the same job to the last bit, bad folders with their places, and every command that reads decks."""

import io
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import musatpy
from musatpy.cli.main import main
from musatpy.errors import DeckError
from musatpy.files import write_files
from musatpy.formats.job_folder import job_files, read_job
from musatpy.formats.short_ids import short_names
from musatpy.model import Block

FIXTURES = Path(__file__).parents[2] / "fixtures"
NO_JOBS = ("bad_decks", "cayman_as11", "st_thomas_as11", "three_photos", "as11_mirrored")  # or with errors
DECKS = sorted(path for path in FIXTURES.glob("*/*.crd") if not {path.parent.name, path.stem} & {*NO_JOBS})


def same(a: Block, b: Block) -> None:
    """Assert that two blocks are equal to the last bit."""
    assert a.options == b.options and a.titles == b.titles
    for name, table in a.tables().items():
        for column in fields(table):
            first, second = (getattr(of, column.name) for of in (table, b.tables()[name]))
            assert np.array_equal(first, second, equal_nan=first.dtype.kind == "f"), (name, column.name)


@pytest.mark.parametrize("deck", DECKS, ids=lambda path: path.stem)
def test_a_job_says_what_its_deck_does_and_equal_jobs_are_equal_files(deck: Path, tmp_path: Path) -> None:
    block, folder = musatpy.read_deck(deck), tmp_path / "x.job"
    contents = job_files(block, folder)
    write_files(contents)
    again = musatpy.read_deck(folder)
    same(block, again)
    assert job_files(again, folder) == contents


def job(tmp_path: Path) -> Path:
    folder = tmp_path / "thomas.job"
    write_files(job_files(musatpy.read_deck(FIXTURES / "st_thomas" / "st_thomas.crd"), folder))
    return folder


def refused(folder: Path) -> str:
    with pytest.raises(DeckError) as caught:
        musatpy.read_deck(folder)
    return str(caught.value)


def test_halves_that_disagree_are_refused(tmp_path: Path) -> None:
    folder = job(tmp_path)
    tables = folder / "tables.npz"
    tables.write_bytes(tables.read_bytes() + b"x")
    assert "not the one that was written with it" in refused(folder)
    tables.unlink()
    assert "tables.npz" in refused(folder)


def with_tables(folder: Path, **arrays: object) -> None:
    """Replace tables of a job, and its digest."""
    from hashlib import sha256

    tables, text = folder / "tables.npz", folder / "job.toml"
    old = sha256(tables.read_bytes()).hexdigest()
    with np.load(tables) as found:
        now = {name: found[name] for name in found.files} | arrays
    data = io.BytesIO()
    np.savez(data, **now)
    tables.write_bytes(data.getvalue())
    text.write_text(text.read_text().replace(old, sha256(data.getvalue()).hexdigest()))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"plates/plates.xz": np.zeros(3)}, r"tables.npz plates.xz: no column is called so; did you mean"),
        ({"plate/plates.xy": np.zeros(3)}, r"tables.npz plate: no table is called so; did you mean plates"),
        ({"plates/plates.xy": np.zeros((3, 2))}, r"tables.npz plates: its columns have \[3, 48\] rows"),
        (
            {"plates/plates.xy": np.zeros((48, 3))},
            r"tables.npz plates.xy: '48 x 3 of the type float64' is not 48 x 2 numbers",
        ),
        ({"plates/plates.xy": np.full((48, 2), "a")}, r"plates.xy: '48 x 2 of the type <U1' is not 48 x 2 numbers"),
        ({"plates/plates.xy": np.full((48, 2), None)}, r"tables.npz: it cannot be read: Object arrays"),
    ],
)
def test_tables_that_cannot_be_are_refused_with_their_names(
    arrays: dict[str, object], message: str, tmp_path: Path
) -> None:
    folder = job(tmp_path)
    with_tables(folder, **arrays)
    with pytest.raises(DeckError, match=message):
        read_job(folder)


def test_what_is_wrong_between_rows_is_told_with_table_row_and_names(tmp_path: Path) -> None:
    folder = job(tmp_path)
    with np.load(folder / "tables.npz") as found:
        photo = found["plates/plates.photo"].astype("<U9")
    photo[4] = "nowhere"
    with_tables(folder, **{"plates/plates.photo": photo})
    assert "thomas.job plates 5 (nowhere, " in refused(folder) and "no station" in refused(folder)


def test_commands_take_a_job_for_a_deck(tmp_path: Path) -> None:
    folder, deck = job(tmp_path), FIXTURES / "st_thomas" / "st_thomas.crd"
    run = CliRunner().invoke

    def listing(source: Path, *more: str) -> str:
        result = run(main, ["run", "-q", str(source), "-o", str(tmp_path / "out"), *more])
        assert result.exit_code == 0, result.output
        return (tmp_path / "out" / f"{source.stem}.lst").read_text()

    assert listing(folder) == listing(deck)
    with_setting = listing(folder, "--set", "OPT.program=IIIA", "--set", "OPT.refraction=RIGOROUS")
    assert with_setting == listing(deck, "--set", "OPT.program=IIIA", "--set", "OPT.refraction=RIGOROUS")
    assert "0 errors" in run(main, ["check", str(folder)]).output
    assert run(main, ["list", str(folder)]).exit_code == 0
    back = tmp_path / "back.crd"
    assert run(main, ["convert", str(folder), str(back)]).exit_code == 0
    assert run(main, ["convert", str(back), str(tmp_path / "again.job")]).exit_code == 0
    same(musatpy.read_deck(back), musatpy.read_deck(tmp_path / "again.job"))


@pytest.fixture
def long_job(tmp_path: Path) -> Path:
    """A job with names that do not go into cards, and something of another program."""
    block = musatpy.read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    long = {"photos": "flight/DJI_{}.JPG", "points": "pt_{}_of_the_model", "cameras": "FC6310, {}"}
    tables = {
        name: replace(table, ids=np.array([words.format(of) for of in table.ids.tolist()]))
        for name, words in long.items()
        for table in (getattr(block, name),)
    }
    folder = tmp_path / "long.job"
    write_files(job_files(replace(block, **tables), folder, {"pixel": np.array([0.0024])}, {"cameras.xml": "ab"}))
    return folder


def musat(*words: object) -> str:
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def test_photos_of_a_job_with_long_names_become_a_job_or_a_deck(long_job: Path, tmp_path: Path) -> None:
    photos = musatpy.read_deck(long_job).photos.ids.tolist()
    part, rest, whole = (tmp_path / name for name in ("part.job", "rest.job", "whole.crd"))
    assert "3 photos" in musat("extract", long_job, "--photos", ",".join(photos[:3]), "-o", part)
    assert musatpy.read_deck(part).photos.ids.tolist() == photos[:3]
    assert read_job(part).source["pixel"] == 0.0024 and read_job(part).inputs == {"cameras.xml": "ab"}
    musat("extract", long_job, "--photos", ",".join(photos[2:]), "-o", rest)
    musat("merge", part, rest, "--join-photos", "-o", whole)
    short, names = musatpy.read_deck(whole), whole.with_suffix(".ids.csv").read_text()
    assert np.array_equal(short.plates.xy.round(5), musatpy.read_deck(long_job).plates.xy.round(5))
    assert all(f'photos,{new},"{old}"' in names for old, new in zip(photos, short.photos.ids, strict=True))
    assert f'cameras,{short.cameras.ids[0]},"FC6310, ' in names
    stream = CliRunner().invoke(main, ["extract", str(long_job), "--photos", photos[0], "-o", "-"])
    assert stream.exit_code == 1 and "is not A8" in stream.output  # nowhere to put the names


def test_what_is_punched_of_a_job_with_long_names_is_a_job_or_has_them_beside_it(
    long_job: Path, tmp_path: Path
) -> None:
    out, punch = tmp_path / "out", ("--punch", "restart", "--punch-family", "job")
    musat("run", "-q", long_job, "-o", out, *punch, "--set", "OP2.editing=EDIT", "--punch-edits")
    photos, again, short = (
        musatpy.read_deck(path).photos.ids.tolist()
        for path in (long_job, out / "long.job", out / "long.edited.crd")
    )
    assert photos == again
    names = (out / "long.edited.ids.csv").read_text()
    assert all(f'photos,{new},"{old}"' in names for old, new in zip(photos, short, strict=True))


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (["7", "12"], ["7", "12"]),
        (["DJI_20260109141611_0031.JPG", "DJI_20260109141612_0032.JPG"], ["0031", "0032"]),
        (["a/102MEDIA/DJI_0002.JPG", "a/103MEDIA/DJI_0003.JPG"], ["0002", "0003"]),
        (["x/IMG0001234567.JPG", "x/IMG0001234568.JPG"], ["7", "8"]),
        (["a/DJI_0002.JPG", "b/DJI_0002.JPG"], ["P0000001", "P0000002"]),
        (["Küste", "Land"], ["Küste", "Land"]),
        (["auf der Küste", "am Land"], ["Küste", "Land"]),
    ],
)
def test_short_names_are_the_shortest_tails_that_tell_all_apart(names: list[str], short: list[str]) -> None:
    assert short_names(names, 8, "P") == short
