"""Real models, which stand beside the project: the residuals that their programs had."""

import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from musatpy.geometry.geodesy import Ellipsoid, metric_differences
from musatpy.model import EllipsoidSpec
from musatpy.sfm import colmap, metashape, opensfm
from musatpy.sfm.conventions import prove
from musatpy.sfm.georeference import level_positions

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases" / "sfm"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="the real models stand beside the project, not in it")


@pytest.mark.parametrize("name", ["colmap_bin", "colmap_txt"])
def test_sceaux_has_the_mean_residual_of_colmap(name: str) -> None:
    model = colmap.read_model(CASES / "sceaux" / name)
    assert (len(model.photos), len(model.points), len(model.photo)) == (11, 7862, 37123)
    size = np.linalg.norm(model.residuals(), axis=1)
    mean = np.bincount(model.point, size) / model.counts
    assert mean.mean() == pytest.approx(0.60434, abs=3e-5)  # the text has its pixels rounded
    assert np.abs(mean - model.stored).max() < 0.01


@pytest.mark.parametrize("name", ["colmap_not_shared_txt", "colmap_txt_missing_cams_and_subfolders"])
def test_other_forms_of_sceaux_are_proven(name: str) -> None:
    model = colmap.read_model(CASES / "sceaux" / name)
    proof = prove(model, name)
    assert proof is not None and proof.median < 0.6 and not proof.notes
    assert any("/" in photo for photo in model.photos) == name.endswith("subfolders")


def test_berlin_has_the_residuals_of_opensfm(tmp_path: Path) -> None:
    for name, source in (
        ("reconstruction.json", "reconstruction_example.json"),
        ("tracks.csv", "tracks_example.csv"),
    ):
        shutil.copy(CASES / "berlin" / source, tmp_path / name)
    model = opensfm.read_model(tmp_path / "reconstruction.json")
    assert (len(model.photos), len(model.photo)) == (3, 3082)
    error = model.residuals()
    assert np.median(np.linalg.norm(error, axis=1)) == pytest.approx(0.80, abs=0.01)
    assert np.sqrt(np.mean(np.square(error))) == pytest.approx(1.74, abs=0.01)
    assert prove(model, "berlin") is not None


def test_cameras_of_metashape_stand_where_their_references_are() -> None:
    path = CASES / "metashape" / "cameras.xml"
    model = metashape.read_model(path)
    assert len(model.photos) == 915 and model.notes == ("7 of 922 photos are not aligned: they are left out",)
    assert len({name.rpartition("/")[2] for name in model.photos.tolist()}) < 622 + 1
    assert np.isnan(model.reference).all()  # none is enabled
    level, ellipsoid = level_positions(np.array([[-120.0, 39.0, 2000.0]]), model.reference_system)
    assert ellipsoid is not None and np.degrees(level[0, :2]) == pytest.approx([39.0, -120.0])
    stated = {
        camera.get("label"): [float(camera.find("reference").get(axis)) for axis in "yxz"]
        for camera in ElementTree.parse(path).iter("camera")
        if camera.find("reference") is not None
    }
    reference = np.array([stated[name] for name in model.photos.tolist()])
    reference[:, :2] = np.radians(reference[:, :2])
    assert model.to_geocentric is not None
    there = model.centre @ model.to_geocentric[:3, :3].T + model.to_geocentric[:3, 3]
    gap = metric_differences("GEOG", EllipsoidSpec(name="WGS84"), reference, Ellipsoid("WGS84").geographic(there))
    assert (np.sqrt(np.mean(np.square(gap[:, :2]), axis=0)) < 2.5).all()
    assert (np.median(np.abs(gap[:, :2]), axis=0) < 2.1).all()
    assert gap[:, 2].std() == pytest.approx(44.0, abs=1.0)
