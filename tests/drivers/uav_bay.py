"""A drone block over a bay, as its owner has it: a COLMAP model whose bundle knew of no water, and what is true.

Images are simulated through the water and a lens (`musat simulate`), adjusted as if there were no water with the
the lens unknown, and written in a gauge of their own; the cloud is where straight rays of that model meet.
"""

from __future__ import annotations

import argparse
import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, CauseSearch, Points, Solution
from musatpy.pipeline import adjust
from musatpy.sfm.block import TURN, lens_of, pixels_of
from musatpy.sfm.colmap import write_model
from musatpy.sfm.model import Model
from musatpy.simulation import simulate

SIZE = 0.0024  # mm of a pixel
WIDTH, HEIGHT = 5472, 3648
LEVEL = 1.30  # m above the ellipsoid
CENTRE = [47.6, -122.5]
SHORE = -40.0  # m east of the centre: all points beyond are submerged, two thirds of them
SPEC = {
    "title": ["DRONE BLOCK OVER A BAY"],
    "job": {"centre": CENTRE, "ellipsoid": "WGS84"},
    "camera": {"focal_length": 8.8, "format": [WIDTH * SIZE, HEIGHT * SIZE], "margin": 0.1},
    "lens": {
        "side": "IDEAL",
        "parameter": [
            {"name": "F", "change": 0.0412},
            {"name": "XP", "change": 0.021},
            {"name": "YP", "change": -0.013},
            {"name": "K1", "change": -1.1e-4},
            {"name": "K2", "change": 1.2e-6},
        ],
    },
    "flight": {
        "photos": 9, "strips": 4, "height": 80.0, "forward_overlap": 0.8, "side_overlap": 0.65,
        "reverse_alternate": True, "station_scatter": 1.0, "attitude_scatter": 2.0,
    },
    "terrain": {"level": 6.0, "relief": 3.0, "wavelength": 140.0},
    "water": {"level": LEVEL, "tide_sigma": 0.02, "level_error": 0.01},
    "shoal": [{"depth": [0.2, 7.0], "area": [SHORE, 400.0, -400.0, 400.0]}],
    "points": {"extra": [{"number": 900}]},
    "control": [{"kind": "full", "number": 6, "sigma": 0.02, "error": 0.02}],
    "stations": {"position_error": 0.03, "position_sigma": 0.03, "attitude_error": 1.0},
    "measurement": {"noise": 0.5 * SIZE * 1000.0, "sigma": 0.5 * SIZE * 1000.0},
    "options": {"program": "IIIA", "refraction": "RIGOROUS"},
}  # fmt: skip


GAUGE = Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix(), 1.0 / 11.7  # of the model: rotation, scale
WGS84 = Ellipsoid("WGS84")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bay:
    """What is simulated: the block as a refracted adjustment would have it, its blind adjustment, and its cloud."""

    block: Block
    truth: object
    blind: Solution
    model: Model  # of COLMAP, without the images of control
    cloud: np.ndarray  # (c, 3) in the coordinates of the model
    cloud_truth: np.ndarray  # (c, 3) latitude, longitude (rad), height
    cloud_wet: np.ndarray  # (c,)


def bay(seed: int, folder: Path, cloud: int = 3000, points: int = 900) -> Bay:
    """Simulate a bay; its spec is written into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    spec = folder / "bay.toml"
    spec.write_text(toml_of(SPEC | {"points": {"extra": [{"number": points}]}}), encoding="utf-8")
    simulated = simulate(spec, seed=seed)
    block = simulated.block
    solution = adjust(blind(block), causes=CauseSearch.NONE)
    assert solution.converged and solution.parameters is not None
    model = model_of(block, solution)
    dense = SPEC | {"points": {"extra": [{"number": cloud}]}, "control": []}
    spec.write_text(toml_of(dense), encoding="utf-8")
    more = simulate(spec, seed=seed)
    assert np.array_equal(more.truth.stations.xyz, simulated.truth.stations.xyz)
    spec.unlink()
    plates = more.block.plates
    lens = model.lenses[0]
    pixel = pixels_of(lens, plates.xy, SIZE)
    position = met(model, plates.photo, plates.point, pixel, len(more.block.points.ids))
    seen = np.flatnonzero(np.isfinite(position).all(axis=1))
    return Bay(
        block=block,
        truth=simulated.truth,
        blind=solution,
        model=model,
        cloud=position[seen],
        cloud_truth=more.truth.points.job[seen],
        cloud_wet=more.truth.bathymetric[seen],
    )


def blind(block: Block) -> Block:
    """The block as a bundle without water sees it: nothing submerged, the lens free, GNSS for the gauge."""
    n = len(block.points.ids)
    return replace(
        block,
        water=None,
        control=type(block.control)(
            point=np.zeros(0, int), kind=np.zeros(0, int), fixed=np.zeros(0, bool), position=np.zeros((0, 3)),
            sigma=np.zeros((0, 3)),
        ),
        points=Points(ids=block.points.ids, bathymetric=np.zeros(n, dtype=bool), dry=np.zeros(n, dtype=bool)),
        photos=replace(block.photos, tide=np.full(len(block.photos.ids), np.nan)),
    )  # fmt: skip


def model_of(block: Block, solution: Solution) -> Model:
    """The blind solution as a model of COLMAP, in a gauge of its own."""
    photos, table = solution.stations, solution.parameters
    assert table is not None
    values = dict(zip(table.parameter.tolist(), table.value.tolist(), strict=True))
    camera = block.cameras
    plain = lens_of({"F": float(camera.focal_length[0])}, _format(), SIZE)
    lens = lens_of(values, plain, SIZE)
    rotation, scale = GAUGE
    centre = WGS84.geocentric(photos.position)
    middle = centre.mean(axis=0)
    M = TURN @ attitude_matrix(photos.attitude) @ WGS84.frame(photos.position)
    control = np.isin(np.arange(len(block.points.ids)), block.control.point)
    kept = np.flatnonzero(~control & np.isfinite(solution.points.position).all(axis=1))
    number = np.full(len(block.points.ids), -1)
    number[kept] = np.arange(len(kept))
    rows = np.flatnonzero(number[block.plates.point] >= 0)
    return Model(
        program="colmap",
        cameras=("1",),
        lenses=(lens,),
        photos=np.array([f"DCIM/DJI_20260109{name:0>6}.JPG" for name in block.photos.ids.tolist()]),
        camera=np.zeros(len(photos.position), dtype=np.int64),
        rotation=M @ rotation.T,
        centre=scale * (centre - middle) @ rotation.T,
        points=np.array([str(number + 1) for number in range(len(kept))]),
        position=scale * (WGS84.geocentric(solution.points.position[kept]) - middle) @ rotation.T,
        photo=block.plates.photo[rows],
        point=number[block.plates.point[rows]],
        pixel=pixels_of(lens, block.plates.xy[rows], SIZE),
    )


def _format():
    from musatpy.reduction.pixel_lens import PixelLens

    return PixelLens(width=WIDTH, height=HEIGHT, focal=(1.0, 1.0), centre=(0.0, 0.0))


def met(model: Model, photo: np.ndarray, point: np.ndarray, pixel: np.ndarray, count: int) -> np.ndarray:
    """Where the straight rays of a model meet best, (count, 3); NaN of less than three rays."""
    xy = model.lenses[0].rays(pixel)
    ray = np.einsum("rji,rj->ri", model.rotation[photo], np.column_stack([xy, np.ones(len(xy))]))
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    N, b = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(N, point, across)
    np.add.at(b, point, np.einsum("rij,rj->ri", across, model.centre[photo]))
    few = np.bincount(point, minlength=count) < 3
    N[few] = np.eye(3)
    return np.where(few[:, None], np.nan, np.linalg.solve(N, b[..., None])[..., 0])


def toml_of(spec: dict) -> str:
    """A spec as TOML."""
    lines: list[str] = []

    def write(name: str, table: dict) -> None:
        plain = {key: value for key, value in table.items() if not _is_table(value)}
        lines.extend([f"[{name}]"] if name else [])
        lines.extend(f"{key} = {json.dumps(value)}" for key, value in plain.items())
        for key, value in table.items():
            below = f"{name}.{key}" if name else key
            if isinstance(value, dict):
                write(below, value)
            elif key not in plain:
                for part in value:
                    lines.append(f"[[{below}]]")
                    lines.extend(f"{inner} = {json.dumps(of)}" for inner, of in part.items())

    write("", spec)
    return "\n".join(lines) + "\n"


def _is_table(value: object) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def files_of(bay: Bay, folder: Path) -> None:
    """Write the folder that its owner has: model, control, positions and times, tide, shoreline, cloud."""
    folder.mkdir(parents=True, exist_ok=True)
    write_model(bay.model, folder)
    block, lens = bay.block, bay.model.lenses[0]
    ids, control = block.points.ids, block.control
    import pyproj

    utm = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:32610", always_xy=True)
    lines = ["EPSG:32610"]
    for row, point in enumerate(control.point.tolist()):
        lat, lon, height = control.position[row].tolist()
        east, north = utm.transform(np.degrees(lon), np.degrees(lat))
        for image in np.flatnonzero(block.plates.point == point).tolist():
            x, y = (pixels_of(lens, block.plates.xy[image], SIZE) - 0.5).tolist()  # the middle of the first is zero
            name = bay.model.photos[block.plates.photo[image]].rpartition("/")[2]
            lines.append(f"{east:.4f} {north:.4f} {height:.4f} {x:.3f} {y:.3f} {name} GCP{ids[point]}")
    (folder / "gcp_list.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with (folder / "exif.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["SourceFile", "UTCAtExposure", "GPSLatitude", "GPSLongitude", "GPSAltitude", "RtkFlag",
                       "RtkStdLon", "RtkStdLat", "RtkStdHgt"])  # fmt: skip
        for number, (name, place) in enumerate(
            zip(bay.model.photos.tolist(), block.photos.position.tolist(), strict=True)
        ):
            lat, lon = np.degrees(place[:2]).tolist()
            time = f"2026:01:09 14:{10 + number // 20:02d}:{3 * (number % 20):02d}.00"
            rows.writerow([name, time, f"{lat:.10f}", f"{lon:.10f}", f"{place[2]:.4f}", 50, 0.03, 0.03, 0.03])
    degree = 111320.0 * np.cos(np.radians(CENTRE[0]))
    line = [[CENTRE[1] + SHORE / degree, CENTRE[0] + north] for north in (-0.004, 0.004)]
    shore = {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": line}}
    shoreline = {"type": "FeatureCollection", "features": [shore]}
    (folder / "shoreline.geojson").write_text(json.dumps(shoreline) + "\n", encoding="utf-8")
    tide = [
        f"2026-01-09T{hour:02d}:{minute:02d}:00Z,{block.photos.tide[0]:.3f}"
        for hour in (13, 14, 15)
        for minute in range(0, 60, 10)
    ]
    (folder / "tide.csv").write_text("time,level\n" + "\n".join(tide) + "\n", encoding="utf-8")
    with (folder / "cloud.csv").open("w", encoding="utf-8") as file:
        file.write("x,y,z\n")
        file.writelines(f"{x:.6f},{y:.6f},{z:.6f}\n" for x, y, z in bay.cloud.tolist())
    with (folder / "truth.csv").open("w", encoding="utf-8") as file:
        file.write("longitude,latitude,height,wet\n")
        for (lat, lon, height), wet in zip(bay.cloud_truth.tolist(), bay.cloud_wet.tolist(), strict=True):
            file.write(f"{np.degrees(lon):.9f},{np.degrees(lat):.9f},{height:.4f},{int(wet)}\n")


def picture(folder: Path, path: Path) -> None:
    """Draw errors of heights over depth: of the cloud as it was, and in `true.csv` of its folder."""
    import matplotlib.pyplot as plt

    from musatpy.sfm.source import cameras_of_job

    with (folder / "true.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    height = np.genfromtxt(folder / "truth.csv", delimiter=",", skip_header=1)[:, 2]
    corrected = np.array([float(row["true_z"] or "nan") for row in rows])
    cloud = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    before = cameras_of_job(folder / "bay.job").placement.positions(cloud)[:, 2]
    plt.rcParams |= {"svg.hashsalt": "musatpy", "svg.fonttype": "none"}
    figure, axes = plt.subplots(figsize=(7.0, 3.4), layout="constrained")
    for values, colour, label in ((before, "#b03a2e", "the model as it was"), (corrected, "#1f4e8c", "corrected")):
        axes.plot(LEVEL - height, values - height, ".", markersize=3, color=colour, label=label)
    axes.axvline(0.0, color="0.6", linewidth=0.8)
    axes.set(xlabel="depth below the water, m (land to the left)", ylabel="height, estimated minus true, m")
    axes.legend(frameon=False, loc="center left")
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Write the files of one seed, or a picture of what has come of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cloud", type=int, default=3000, help="points of the cloud")
    parser.add_argument("--points", type=int, default=900, help="points of the model")
    parser.add_argument("--picture", type=Path, help="draw this from a folder that was imported and corrected")
    given = parser.parse_args()
    if given.picture:
        picture(given.folder, given.picture)
        return
    files_of(bay(given.seed, given.folder, given.cloud, given.points), given.folder)


if __name__ == "__main__":
    main()
