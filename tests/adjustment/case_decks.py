"""Real data with independent answers as blocks: the Strasbourg block (DBAT) and two single-photo resections."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from musatpy import model
from musatpy.units import DEGREE

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
PIXEL = 0.006  # mm, of the Strasbourg block


def load_case(name: str) -> dict[str, Any]:
    """Return one case file, or skip the test where the data folder is not beside the repository."""
    path = CASES / f"{name}.json"
    if not path.exists():
        pytest.skip(f"no {path.name} in shared/cases beside the repository")
    data: dict[str, Any] = json.loads(path.read_text())
    return data


def strasbourg(case: dict[str, Any], variant: str) -> model.Block:
    """Return the five-photo block as DBAT adjusted it: variant S1 (fixed control), S2 (weighted) or S4 (smart).

    x = 0.006 px - 26.577, y = 38.811 - 0.006 py in millimetres; image sigma 1 px; no sigmas on the stations, which
    start from a plane similarity rounded to 5 m and 0.1 degree.
    """
    marks = case["mark_id_image_px_py"] + (case["smart_id_image_px_py"] if variant == "S4" else [])
    images = list(case["image_names"])
    rows = case["control_id_name_XYZ_sxsysz"]
    return local_block(
        title=f"STRASBOURG 1:14 000, DBAT {variant}",
        focal_length=case["camera"]["c_mm"],
        photo=np.array([images.index(str(mark[1])) for mark in marks]),
        photo_ids=[case["image_names"][i] for i in images],
        names=[str(mark[0]) for mark in marks],
        xy=(np.array([mark[2:] for mark in marks]) * PIXEL - case["camera"]["pp_mm"]) * [1.0, -1.0],
        plate_sigma=PIXEL,
        control={str(row[0]): row[2:5] for row in rows},
        control_sigma=None if variant == "S1" else np.array([row[5:] for row in rows]),
    )


def resection(case: dict[str, Any]) -> model.Block:
    """Return a single photo over fixed control, unit plate sigma so that the sum of squares is in mm2."""
    rows = case["points_id_x_y_X_Y_Z"]
    return local_block(
        title="SINGLE PHOTO RESECTION",
        focal_length=case["f_mm"],
        photo=np.zeros(len(rows), dtype=int),
        photo_ids=["1"],
        names=[row[0] for row in rows],
        xy=np.array([row[1:3] for row in rows]),
        plate_sigma=1.0,
        control={row[0]: row[3:] for row in rows},
        control_sigma=None,
    )


def local_block(
    *,
    title: str,
    focal_length: float,
    photo: np.ndarray,  # (m,) of each image
    photo_ids: list[str],
    names: list[str],  # of the points of the images
    xy: np.ndarray,  # (m, 2) mm from the principal point
    plate_sigma: float,
    control: dict[str, list[float]],
    control_sigma: np.ndarray | None,  # None: it is fixed
) -> model.Block:
    """Return a local rectangular block of one camera with full control.

    It starts from plane similarities, rounded to 5 m and 0.1 degree.
    """
    ids = list(dict.fromkeys([*names, *control]))
    starts = []
    for number in range(len(photo_ids)):
        rows = [row for row in np.flatnonzero(photo == number) if names[row] in control]
        starts.append(near_vertical(xy[rows], np.array([control[names[row]] for row in rows]), focal_length))
    position, attitude = (np.array(values) for values in zip(*starts, strict=True))
    return model.Block(
        titles=(title,),
        options=model.Options(
            system=model.CoordinateSystem.LOCAL,
            refraction=model.Refraction.NONE,
            plate_sigma=plate_sigma,
            max_iterations=30,
        ),
        cameras=model.Cameras(
            ids=["CAM1"], focal_length=[focal_length], principal_point=[[0.0, 0.0]], format_size=[[np.nan, np.nan]]
        ),
        photos=model.Photos(
            ids=photo_ids,
            camera=np.zeros(len(photo_ids), dtype=int),
            position=np.round(position / 5.0) * 5.0,
            attitude=np.round(attitude / (0.1 * DEGREE)) * 0.1 * DEGREE,
        ),
        points=model.Points(ids=ids),
        plates=model.PlateMeasurements(photo=photo, point=[ids.index(name) for name in names], xy=xy),
        control=model.Control(
            point=[ids.index(name) for name in control],
            kind=np.full(len(control), model.ControlKind.FULL),
            fixed=np.full(len(control), control_sigma is None),
            position=np.array(list(control.values())),
            sigma=[] if control_sigma is None else control_sigma,
        ),
    )


def near_vertical(xy: np.ndarray, ground: np.ndarray, focal_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (position (3,), (omega, phi, kappa)) of a photo taken straight down over nearly flat ground.

    `xy` (k, 2) plate mm from the principal point, `ground` (k, 3) local coordinates, `focal_length` mm. With no
    tilt, E + iN = (E0 + iN0) + s exp(i kappa) (x + iy), where s is the scale number times 1/1000.
    """
    plate = xy[:, 0] + 1j * xy[:, 1]
    plan = ground[:, 0] + 1j * ground[:, 1]
    terms, *_ = np.linalg.lstsq(np.stack([np.ones_like(plate), plate], axis=1), plan, rcond=None)
    height = ground[:, 2].mean() + abs(terms[1]) * focal_length
    return np.array([terms[0].real, terms[0].imag, height]), np.array([0.0, 0.0, np.angle(terms[1])])
