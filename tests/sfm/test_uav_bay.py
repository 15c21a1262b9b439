"""A drone block over a bay by the commands of its owner: import, run, correct, export; errors and sigmas."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from drivers.uav_bay import Bay, bay, files_of
from musatpy.arrays import FloatArray
from musatpy.cli.main import main
from musatpy.sfm.block import Placement

SEED = 1  # of six that stand in docs/models.md
pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Job:
    """A bay and what is true of it, the folder of its job, what the import says, and the cloud by its run."""

    made: Bay
    folder: Path
    output: str
    cloud: dict[str, FloatArray]


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    folder = tmp_path_factory.mktemp("bay")
    made = bay(SEED, folder, cloud=700, points=500)
    files_of(made, folder)
    output = imported(folder)
    return Job(made, folder, output, corrected(folder))


def musat(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def imported(folder: Path, *more: str, status: int = 0) -> str:
    """Import the model of a folder as its owner does, with more options; the last of an option counts."""
    words = ["import", "colmap", folder, "-o", folder / "bay.job", "--tide-datum", "0", "--tide-sigma", "0.02"]
    words += ["--gcp", folder / "gcp_list.txt", "--gnss", folder / "exif.csv", "--tide", folder / "tide.csv"]
    words += ["--gcp-sigma", "0.02", "--water", folder / "shoreline.geojson", "--water-side", "right"]
    result = musat(*words, *more)
    assert result.exit_code == status, result.output
    return result.output


def corrected(folder: Path) -> dict[str, FloatArray]:
    """The cloud of a bay through its job and its run."""
    assert musat("run", "-q", folder / "bay.job", "-o", folder / "out").exit_code == 0
    words = ["correct", "-q", folder / "cloud.csv", "--run", folder / "out" / "bay.json", "-o", folder / "true.csv"]
    result = musat(*words, "--job", folder / "bay.job", "--crs", "model", "--cloud-sigma", "0.5")
    assert result.exit_code == 0, result.output
    with (folder / "true.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name not in ("reason", "s44")]
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in names}


def test_a_cloud_of_a_blind_model_comes_right_through_its_own_cameras(job: Job) -> None:
    """Blind heights are off by .8 m. All points of one draw share the errors of lens, level and station heights.

    So their RMS over sigmas is that of a chi square with some three degrees of freedom: .2 to 2.
    """
    made, folder, found = job.made, job.folder, job.cloud
    assert "its focal length is off by pixels" in job.output
    error = found["true_z"] - made.cloud_truth[:, 2]
    wet, known = made.cloud_wet, np.isfinite(error)
    assert known.mean() > 0.99
    rms = float(np.sqrt(np.mean(np.square(error[wet & known]))))
    record = json.loads((folder / "out" / "bay.json").read_text())
    sigma = np.array(record["bathymetric_points"]["depth_sigma"], dtype=float)
    assert rms < 1.6 * np.sqrt(np.mean(np.square(sigma)))
    assert 0.2 < np.sqrt(np.mean(np.square(error / found["sigma_z"])[wet & known])) < 2.0
    table = record["adjusted_parameters"]
    row = table["parameter"].index("F")
    assert abs(table["adjusted"][row] - 8.8412) < 2.5 * table["sigma"][row]  # of the truth


@pytest.fixture(scope="module")
def by_rays(job: Job) -> dict[int, dict[str, dict[str, str]]]:
    """The points of the model itself, by id, with at most 36 rays (all) and with at most 6."""
    folder, model = job.folder, job.made.model
    np.savetxt(folder / "model.csv", model.position, delimiter=",", header="x,y,z", comments="", fmt="%.9f")
    rows = {}
    for most in (36, 6):
        words = ["--run", folder / "out" / "bay.json", "--job", folder / "bay.job", "--rays", most]
        words += ["--crs", "model", "--cloud-sigma", "0.5", "-o", folder / "own.csv"]
        result = musat("correct", "-q", folder / "model.csv", *words)
        assert result.exit_code == 0, result.output
        with (folder / "own.csv").open(newline="") as file:
            rows[most] = dict(zip(model.points.tolist(), csv.DictReader(file), strict=True))
    return rows


def test_sigmas_of_the_points_of_the_model_are_those_of_the_adjustment(
    job: Job, by_rays: dict[int, dict[str, dict[str, str]]]
) -> None:
    """By all rays: both have the errors of stations, water, lens and images, by other ways."""
    rows = by_rays[36]
    points = json.loads((job.folder / "out" / "bay.json").read_text())["points"]
    ratios = []
    for point, covariance in zip(points["point"], points["covariance"], strict=True):
        if point in rows and rows[point]["sigma_z"]:
            ratios.append(float(rows[point]["sigma_z"]) / np.sqrt(np.ravel(covariance)[8]))
    low, middle, high = np.percentile(ratios, [5.0, 50.0, 95.0])
    assert 0.98 < low < middle < high < 1.02 and len(ratios) > 300


def test_rays_that_are_left_out_are_in_the_sigmas(by_rays: dict[int, dict[str, dict[str, str]]]) -> None:
    """Heights by 6 rays differ from those by all by what their variances differ; without that, by 1.5 times."""
    of_all, of_six = (
        np.array([[float(row[name] or "nan") for name in ("true_z", "sigma_z", "rays")] for row in rows.values()])
        for rows in by_rays.values()
    )
    fewer = of_six[:, 2] < of_all[:, 2]
    gap = (of_six - of_all)[fewer, 0]
    variance = np.square(of_six[fewer, 1]) - np.square(of_all[fewer, 1])
    assert 0.8 < np.sqrt(np.nanmedian(np.square(gap) / variance) / 0.455) < 1.2  # .455: median of chi square
    assert fewer.sum() > 200


def test_the_commands_of_a_drone_surveyor(job: Job) -> None:
    made, folder, found = job.made, job.folder, job.cloud
    for words in ("points wet by area", "placed by 6 control", "UTCAtExposure"):
        assert words in job.output
    wet = made.cloud_wet
    error = found["true_z"] - made.cloud_truth[:, 2]
    assert np.sqrt(np.nanmean(np.square(error[wet]))) < 0.05
    assert np.sqrt(np.nanmean(np.square(error[~wet]))) < 0.05  # no step at the shore
    for form in ("colmap", "metashape"):
        result = musat("export", form, "--run", folder / "out" / "bay.json", "--job", folder / "bay.job", "-o",
                       folder / "export", "--points", "apparent")  # fmt: skip
        assert result.exit_code == 0, result.output
    again = musat("import", "colmap", folder / "export", "-o", folder / "again.job", "--gnss", folder / "exif.csv")
    assert again.exit_code == 0, again.output  # whose residuals prove its convention
    photos = (folder / "bay.photos.csv").read_text().splitlines()
    assert photos[1] == '"DCIM/DJI_20260109000001.JPG",2026-01-09 14:10:00 UTC,UTCAtExposure,1.3100,0.0200,FLIGHT1'


def test_the_commands_of_the_readme_go_from_the_example_to_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text().replace("\\\n", "")
    block = readme.split("## A drone survey")[1].split("```")[1]
    lines = [line.removesuffix(" && cd bay") for line in block.splitlines() if line.startswith("musat ")]
    (tmp_path / "bay").mkdir()
    monkeypatch.chdir(tmp_path)
    for line in lines:
        result = musat(*line.split()[1:])
        assert result.exit_code == 0, result.output
        monkeypatch.chdir(tmp_path / "bay")
    assert (
        len(lines) == 5 and (tmp_path / "bay" / "bay.html").is_file() and (tmp_path / "bay" / "true.csv").is_file()
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--crs", "local"), ""),
        (("--tide-datum", "nonsense"), "neither a height in metres nor a grid"),
        (("-o", "bay.crd"), "a job folder is called NAME.job"),
        (("--gcp", "missing.txt"), "missing.txt"),
    ],
)
def test_what_cannot_be_imported_is_refused_with_a_reason(
    job: Job, options: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    status = 0 if not message else 2 if options[0] == "-o" else 1  # the list states its own system
    assert message in imported(job.folder, "-o", str(tmp_path / "bay.job"), *options, status=status)


def test_a_run_of_another_job_is_refused(job: Job, tmp_path: Path) -> None:
    folder = job.folder
    deck = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"
    assert musat("run", "-q", deck, "-o", tmp_path).exit_code == 0
    words = ["correct", folder / "cloud.csv", "--run", tmp_path / "st_thomas.json", "-o", tmp_path / "x.csv"]
    result = musat(*words, "--job", folder / "bay.job")
    assert result.exit_code == 1 and "none of its photos is one of the cameras of the job" in result.output


def test_a_placement_on_the_ellipsoid_states_its_system() -> None:
    from musatpy.geometry.geodesy import Ellipsoid

    placement = Placement(
        scale=1.0, rotation=np.eye(3), shift=np.zeros(3), ellipsoid=Ellipsoid("", 6378000.0, 300.0)
    )
    spec = placement.ellipsoid_spec
    assert spec is not None and (spec.semi_major_axis, spec.inverse_flattening) == (6378000.0, 300.0)


def test_a_run_that_has_not_converged_gives_no_cameras(job: Job, tmp_path: Path) -> None:
    text = (job.folder / "out" / "bay.json").read_text()
    assert '"converged": true' in text
    (tmp_path / "bay.json").write_text(text.replace('"converged": true', '"converged": false', 1))
    words = ["--run", tmp_path / "bay.json", "--job", job.folder / "bay.job", "-o", tmp_path / "out.csv"]
    for command in (["correct", job.folder / "cloud.csv", "--crs", "model"], ["export", "colmap"]):
        result = musat(*command, *words)
        assert result.exit_code == 1 and "bay.json: the run has not converged" in result.output
    assert not (tmp_path / "out.csv").exists()
