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
    camera = case["camera"]
    pp = np.array(camera["pp_mm"])
    pixels = np.array([mark[2:] for mark in marks])
    xy = (pixels * PIXEL - pp) * [1.0, -1.0]
    photo_ids = list(case["image_names"])
    control = np.array([row[2:5] for row in case["control_id_name_XYZ_sxsysz"]])
    control_ids = [str(row[0]) for row in case["control_id_name_XYZ_sxsysz"]]
    point_ids = list(dict.fromkeys([str(mark[0]) for mark in marks] + control_ids))
    photo = np.array([photo_ids.index(str(mark[1])) for mark in marks])
    point = np.array([point_ids.index(str(mark[0])) for mark in marks])
    ground = dict(zip(control_ids, control, strict=True))
    starts = []
    for i in range(len(photo_ids)):
        rows = [k for k in np.flatnonzero(photo == i) if point_ids[point[k]] in ground]
        known = np.array([ground[point_ids[point[k]]] for k in rows])
        starts.append(near_vertical(xy[rows], known, camera["c_mm"]))
    fixed = variant == "S1"
    return local_block(
        title=f"STRASBOURG 1:14 000, DBAT {variant}",
        focal_length=camera["c_mm"],
        photo_ids=[case["image_names"][i] for i in photo_ids],
        position=np.round(np.array([p for p, _ in starts]) / 5.0) * 5.0,
        attitude=np.round(np.array([a for _, a in starts]) / (0.1 * DEGREE)) * 0.1 * DEGREE,
        point_ids=point_ids,
        plates=(photo, point, xy),
        plate_sigma=PIXEL,
        control_ids=control_ids,
        control=control,
        control_sigma=None if fixed else np.array([row[5:] for row in case["control_id_name_XYZ_sxsysz"]]),
    )


def resection(case: dict[str, Any]) -> model.Block:
    """Return a single photo over fixed control, unit plate sigma so that the sum of squares is in mm2."""
    rows = case["points_id_x_y_X_Y_Z"]
    ids = [row[0] for row in rows]
    xy, ground = np.array([row[1:3] for row in rows]), np.array([row[3:] for row in rows])
    position, attitude = near_vertical(xy, ground, case["f_mm"])
    links = np.arange(len(ids))
    return local_block(
        title="SINGLE PHOTO RESECTION",
        focal_length=case["f_mm"],
        photo_ids=["1"],
        position=np.round(position[None] / 5.0) * 5.0,
        attitude=np.round(attitude[None] / (0.1 * DEGREE)) * 0.1 * DEGREE,
        point_ids=ids,
        plates=(np.zeros_like(links), links, xy),
        plate_sigma=1.0,
        control_ids=ids,
        control=ground,
        control_sigma=None,
    )


def local_block(
    *,
    title: str,
    focal_length: float,
    photo_ids: list[str],
    position: np.ndarray,
    attitude: np.ndarray,
    point_ids: list[str],
    plates: tuple[np.ndarray, np.ndarray, np.ndarray],
    plate_sigma: float,
    control_ids: list[str],
    control: np.ndarray,
    control_sigma: np.ndarray | None,
) -> model.Block:
    """Return a local rectangular block of one camera with full control, fixed where no sigma is given."""
    photo, point, xy = plates
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
            position=position,
            attitude=attitude,
        ),
        points=model.Points(ids=point_ids),
        plates=model.PlateMeasurements(photo=photo, point=point, xy=xy),
        control=model.Control(
            point=[point_ids.index(name) for name in control_ids],
            kind=np.full(len(control_ids), model.ControlKind.FULL),
            fixed=np.full(len(control_ids), control_sigma is None),
            position=control,
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
