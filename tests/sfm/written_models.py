"""One scene as COLMAP, OpenSfM and Metashape write it, by scalars alone: no line is shared with the readers.

`wrong` is a convention that a file has in place of its format's, one of `WRONG`.
"""

from __future__ import annotations

import json
import math
import random
import struct
from dataclasses import dataclass, field
from pathlib import Path

Vector = list[float]
Matrix = list[Vector]

LATITUDE, LONGITUDE, HEIGHT = 18.3, -64.9, -40.0  # degrees, m: where the origin of the scene stands
COLMAP = (
    "middle", "first at 0", "first at 1", "y up", "x for y", "principal point from the middle",
    "principal point y up", "p1 for p2", "images to rays", "transposed", "inverse", "t for C", "scalar last",
    "camera y up",
)  # fmt: skip
OPENSFM = (
    "corner", "first at 0", "first at 1", "y up", "shorter side", "half side", "focal by shorter side",
    "p1 for p2", "images to rays", "transposed", "inverse", "t for C", "camera y up",
)  # fmt: skip
METASHAPE = (
    "principal point from the corner", "principal point y up", "p1 for p2", "images to rays", "transposed",
    "inverse", "t for C", "camera y up", "y down", "x up", "x left", "x down", "micrometres", "pixels",
    "about principal point", "no distortion", "initial",
)  # fmt: skip
PIXEL_WIDTH, PIXEL_HEIGHT, FOCAL_LENGTH = 0.0024, 0.0025, 7.5  # mm, as Metashape states them


@dataclass
class Lens:
    """The lens of OpenCV, pixels from the corner."""

    width: int = 4000
    height: int = 3000
    fx: float = 3110.0
    fy: float = 3105.0
    cx: float = 2027.0
    cy: float = 1471.0
    k: Vector = field(default_factory=lambda: [-0.11, 0.07, -0.012])
    p: Vector = field(default_factory=lambda: [0.004, -0.007])
    inverse: bool = False  # the polynomials lead from images to rays

    def bent(self, x: float, y: float) -> tuple[float, float]:
        q = x * x + y * y
        g = 1.0 + q * (self.k[0] + q * (self.k[1] + q * self.k[2]))
        p1, p2 = self.p
        return (
            x * g + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
            y * g + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        u, v = (x, y) if self.inverse else self.bent(x, y)
        for _ in range(80 if self.inverse else 0):
            a, b = self.bent(u, v)
            u, v = u + x - a, v + y - b
        return self.cx + self.fx * u, self.cy + self.fy * v


@dataclass
class Scene:
    """Photos over points, east, north, up."""

    lens: Lens
    names: list[str]
    R: list[Matrix]  # world to camera: x right, y down, z forward
    C: list[Vector]
    points: list[Vector]
    images: list[tuple[int, int, float, float]]  # photo, point, pixels from the corner, measured
    residual: Vector  # of each point, the mean


def product(a: Matrix, b: Matrix) -> Matrix:
    return [[sum(a[i][k] * b[k][j] for k in range(len(b))) for j in range(len(b[0]))] for i in range(len(a))]


def applied(a: Matrix, v: Vector) -> Vector:
    return [sum(a[i][k] * v[k] for k in range(3)) for i in range(3)]


def transpose(a: Matrix) -> Matrix:
    return [[a[j][i] for j in range(3)] for i in range(3)]


def turn(axis: int, angle: float) -> Matrix:
    c, s = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = [[float(r == k) for k in range(3)] for r in range(3)]
    out[i][i], out[j][j], out[i][j], out[j][i] = c, c, -s, s
    return out


def scene(noise: float = 0.0, lens: Lens | None = None, wide: int = 4) -> Scene:
    """Return 3 strips of `wide` photos, tilted and turned, 80 m over 130 points; noise in px an axis."""
    lens, chance = lens or Lens(), random.Random(5)
    names, R, C = [], [], []
    for number in range(3 * wide):
        x, y = 30.0 * (number % wide) - 40.0, 25.0 * (number // wide) - 25.0
        names.append(f"flight {number % 2}/DJI_{number:04d}.JPG")
        C.append([x + chance.uniform(-3, 3), y + chance.uniform(-3, 3), 80.0 + chance.uniform(-4, 4)])
        tilted = product(turn(0, chance.uniform(-0.25, 0.25)), turn(1, chance.uniform(-0.25, 0.25)))
        down = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
        R.append(product(product(down, tilted), turn(2, chance.uniform(-2.5, 2.5))))
    points = [
        [chance.uniform(-75, 85), chance.uniform(-55, 55), chance.uniform(-6, 9)] for _ in range(32 * wide + 2)
    ]
    images: list[tuple[int, int, float, float]] = []
    gaps: list[Vector] = [[] for _ in points]
    for photo, (M, c) in enumerate(zip(R, C, strict=True)):
        for point, X in enumerate(points):
            x, y, z = applied(M, [X[k] - c[k] for k in range(3)])
            u, v = lens.pixel(x / z, y / z)
            if math.hypot(x, y) < z and 0 < u < lens.width and 0 < v < lens.height:
                du, dv = (chance.gauss(0.0, noise) for _ in range(2))
                images.append((photo, point, u + du, v + dv))
                gaps[point].append(math.hypot(du, dv))
    kept = [n for n, gap in enumerate(gaps) if len(gap) > 1]
    images = [(photo, kept.index(point), u, v) for photo, point, u, v in images if point in kept]
    residual = [sum(gaps[n]) / len(gaps[n]) for n in kept]
    return Scene(lens, names, R, C, [points[n] for n in kept], images, residual)


def wrong_lens(lens: Lens, wrong: str) -> Lens:
    cx, cy, p = lens.cx, lens.cy, lens.p
    if wrong == "principal point from the middle":
        cx, cy = cx - lens.width / 2, cy - lens.height / 2
    elif wrong == "principal point from the corner":
        cx, cy = cx + lens.width / 2, cy + lens.height / 2
    elif wrong == "principal point y up":
        cy = lens.height - cy
    elif wrong == "absorbed":
        cx, cy = cx - 0.5, cy - 0.5
    elif wrong == "p1 for p2":
        p = p[::-1]
    return Lens(lens.width, lens.height, lens.fx, lens.fy, cx, cy, lens.k, p)


def wrong_pixel(lens: Lens, u: float, v: float, wrong: str) -> tuple[float, float]:
    w, h = lens.width, lens.height
    return {
        "middle": (u - w / 2, v - h / 2),
        "corner": (u + w / 2, v + h / 2),
        "first at 0": (u - 0.5, v - 0.5),
        "absorbed": (u - 0.5, v - 0.5),
        "first at 1": (u + 0.5, v + 0.5),
        "y up": (u, h - v),
        "x for y": (v, u),
    }.get(wrong, (u, v))


def wrong_pose(R: Matrix, C: Vector, wrong: str) -> tuple[Matrix, Vector]:
    """Return a rotation and a translation from the world to the camera."""
    if wrong == "camera y up":
        R = [R[0], [-x for x in R[1]], [-x for x in R[2]]]
    t = [-x for x in applied(R, C)]
    if wrong in ("transposed", "inverse"):
        R = transpose(R)
    return R, C if wrong in ("inverse", "t for C") else t


def quaternion(R: Matrix) -> Vector:
    """Return w, x, y, z."""
    diagonal = [R[i][i] for i in range(3)]
    squares = [1 + sum(diagonal)] + [1 + 2 * d - sum(diagonal) for d in diagonal]
    largest = squares.index(max(squares))
    s = 2.0 * math.sqrt(squares[largest])
    differences = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
    if largest == 0:
        return [s / 4, *(d / s for d in differences)]
    i = largest - 1
    out = [differences[i] / s, *((R[i][j] + R[j][i]) / s for j in range(3))]
    out[1 + i] = s / 4
    return out


def write_colmap(folder: Path, of: Scene, wrong: str = "", *, binary: bool = False, stated: bool = True) -> Path:
    """Write cameras, images and points3D; without `stated` residuals these are -1."""
    folder.mkdir(parents=True, exist_ok=True)
    lens = wrong_lens(of.lens, wrong)
    parameters = [lens.fx, lens.fy, lens.cx, lens.cy, *lens.k[:2], *lens.p, lens.k[2], 0.0, 0.0, 0.0]
    features: list[list[tuple[float, float, int]]] = [[(7.0, 8.0, -1)] for _ in of.names]
    tracks: list[list[int]] = [[] for _ in of.points]
    for photo, point, u, v in of.images:
        tracks[point] += [photo + 3, len(features[photo])]
        features[photo].append((*wrong_pixel(lens, u, v, wrong), 2 * point + 11))
    poses = []
    for R, C in zip(of.R, of.C, strict=True):
        M, t = wrong_pose(R, C, wrong)
        q = quaternion(M)
        poses.append([*(q[1:] + q[:1] if wrong == "scalar last" else q), *t])
    errors = of.residual if stated else [-1.0] * len(of.points)
    if binary:
        data = struct.pack("<QiiQQ12d", 1, 9, 6, lens.width, lens.height, *parameters)
        (folder / "cameras.bin").write_bytes(data)
        data = struct.pack("<Q", len(of.names))
        for number, name in enumerate(of.names):
            data += struct.pack("<I7dI", number + 3, *poses[number], 9) + name.encode() + b"\0"
            data += struct.pack("<Q", len(features[number]))
            data += b"".join(struct.pack("<ddq", *feature) for feature in features[number])
        (folder / "images.bin").write_bytes(data)
        data = struct.pack("<Q", len(of.points))
        for number, (X, error) in enumerate(zip(of.points, errors, strict=True)):
            track = tracks[number]
            data += struct.pack("<Q3d3BdQ", 2 * number + 11, *X, 1, 2, 3, error, len(track) // 2)
            data += struct.pack(f"<{len(track)}I", *track)
        (folder / "points3D.bin").write_bytes(data)
        return folder
    text = f"# cameras\n9 FULL_OPENCV {lens.width} {lens.height} {' '.join(map(repr, parameters))}\n"
    (folder / "cameras.txt").write_text(text)
    lines = ["# images"]
    for number, name in enumerate(of.names):
        lines.append(f"{number + 3} {' '.join(map(repr, poses[number]))} 9 {name}")
        lines.append(" ".join(f"{u!r} {v!r} {point}" for u, v, point in features[number]))
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    lines = [
        f"{2 * n + 11} {X[0]!r} {X[1]!r} {X[2]!r} 1 2 3 {errors[n]!r} {' '.join(map(str, tracks[n]))}"
        for n, X in enumerate(of.points)
    ]
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n")
    return folder


def write_opensfm(folder: Path, of: Scene, wrong: str = "") -> Path:
    """Write reconstruction.json, tracks.csv and reference_lla.json; return the first."""
    folder.mkdir(parents=True, exist_ok=True)
    lens = wrong_lens(of.lens, wrong)
    w, h = lens.width, lens.height
    size = {"shorter side": min(w, h), "half side": max(w, h) / 2}.get(wrong, max(w, h))
    focal = min(w, h) if wrong == "focal by shorter side" else max(w, h)
    camera = {
        "projection_type": "brown", "width": w, "height": h,
        "focal_x": lens.fx / focal, "focal_y": lens.fy / focal,
        "c_x": (lens.cx - w / 2) / max(w, h), "c_y": (lens.cy - h / 2) / max(w, h),
        "k1": lens.k[0], "k2": lens.k[1], "k3": lens.k[2], "p1": lens.p[0], "p2": lens.p[1],
    }  # fmt: skip
    shots = {}
    for name, R, C in zip(of.names, of.R, of.C, strict=True):
        M, t = wrong_pose(R, C, wrong)
        q = quaternion(M)
        sine = math.sqrt(sum(x * x for x in q[1:]))
        angle = 2.0 * math.atan2(sine, q[0])
        shots[name] = {"camera": "one", "rotation": [angle * x / sine for x in q[1:]], "translation": t}
    points = {f"p{n}": {"coordinates": X, "color": [1, 2, 3]} for n, X in enumerate(of.points)}
    content = [{"cameras": {"one": camera}, "shots": shots, "points": points}]
    (folder / "reconstruction.json").write_text(json.dumps(content))
    lines = ["OPENSFM_TRACKS_VERSION_v2"]
    for row, (photo, point, *pixel) in enumerate(of.images):
        u, v = wrong_pixel(lens, *pixel, wrong)
        # The first pixel's middle is 0 in OpenCV, which OpenSfM's half makes up for.
        x, y = (u - 0.5 + 0.5 - w / 2) / size, (v - 0.5 + 0.5 - h / 2) / size
        lines.append(f"{of.names[photo]}\tp{point}\t{row}\t{x!r}\t{y!r}\t0.001\t1\t2\t3\t-1\t-1")
    (folder / "tracks.csv").write_text("\n".join(lines) + "\n")
    lla = {"latitude": LATITUDE, "longitude": LONGITUDE, "altitude": HEIGHT}
    (folder / "reference_lla.json").write_text(json.dumps(lla))
    return folder / "reconstruction.json"


def axes() -> Matrix:
    """Return the matrix from east, north, up to geocentric axes, at the origin of the scene."""
    a, o = math.radians(LATITUDE), math.radians(LONGITUDE)
    return [
        [-math.sin(o), -math.sin(a) * math.cos(o), math.cos(a) * math.cos(o)],
        [math.cos(o), -math.sin(a) * math.sin(o), math.cos(a) * math.sin(o)],
        [0.0, math.cos(a), math.sin(a)],
    ]


def geocentric(X: Vector) -> Vector:
    """Return geocentric coordinates, WGS 84, of a place of the scene."""
    a, o, f = math.radians(LATITUDE), math.radians(LONGITUDE), 1.0 / 298.257223563
    e2 = f * (2.0 - f)
    n = 6378137.0 / math.sqrt(1.0 - e2 * math.sin(a) ** 2)
    r = (n + HEIGHT) * math.cos(a)
    origin = [r * math.cos(o), r * math.sin(o), (n * (1.0 - e2) + HEIGHT) * math.sin(a)]
    return [p + q for p, q in zip(origin, applied(axes(), X), strict=True)]


CHUNK = product(product(turn(0, 0.4), turn(1, -1.1)), turn(2, 2.0))  # chunk to geocentric axes
SCALE, SHIFT = 22.5, [3.0, -2.0, 1.5]


def to_chunk(X: Vector) -> Vector:
    """Return a place of the scene in the coordinates of the chunk."""
    gap = [p - q for p, q in zip(geocentric(X), geocentric([0.0, 0.0, 0.0]), strict=True)]
    return [x / SCALE + s for x, s in zip(applied(transpose(CHUNK), gap), SHIFT, strict=True)]


def write_metashape(path: Path, of: Scene, wrong: str = "", markers: str = "") -> Path:
    """Write cameras.xml; `markers` are elements of the chunk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lens = wrong_lens(of.lens, wrong)
    origin = geocentric([0.0, 0.0, 0.0])
    place = [o - SCALE * x for o, x in zip(origin, applied(CHUNK, SHIFT), strict=True)]
    rotation = " ".join(repr(x) for row in CHUNK for x in row)
    transform = (
        f"<transform><rotation>{rotation}</rotation><translation>{' '.join(map(repr, place))}</translation>"
        f"<scale>{SCALE!r}</scale></transform>"
    )
    cameras = []
    for number, (name, R, C) in enumerate(zip(of.names, of.R, of.C, strict=True)):
        if wrong == "camera y up":
            R = [R[0], [-x for x in R[1]], [-x for x in R[2]]]
        A, b = product(transpose(CHUNK), product(axes(), transpose(R))), to_chunk(C)
        t = [-x for x in applied(transpose(A), b)]
        if wrong in ("inverse", "t for C"):
            b = t
        if wrong in ("inverse", "transposed"):
            A = transpose(A)
        values = [*A[0], b[0], *A[1], b[1], *A[2], b[2], 0.0, 0.0, 0.0, 1.0]
        cameras.append(
            f'<camera id="{number}" sensor_id="0" component_id="0" label="{name}"><transform>'
            f"{' '.join(map(repr, values))}</transform><orientation>1</orientation>"
            f'<reference x="{LONGITUDE}" y="{LATITUDE}" z="40" enabled="true"/></camera>'
        )
    k, (p1, p2) = lens.k, lens.p
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="1" enabled="true">'
        f'<sensors><sensor id="0" label="L" type="frame"><resolution width="{lens.width}" height="{lens.height}"/>'
        f'<property name="pixel_width" value="{PIXEL_WIDTH}"/>'
        f'<property name="pixel_height" value="{PIXEL_HEIGHT}"/>'
        f'<property name="focal_length" value="{FOCAL_LENGTH}"/>'
        f'<calibration type="frame" class="adjusted"><f>{lens.fy!r}</f><b1>{lens.fx - lens.fy!r}</b1>'
        f"<cx>{lens.cx - lens.width / 2!r}</cx><cy>{lens.cy - lens.height / 2!r}</cy><k1>{k[0]!r}</k1>"
        f"<k2>{k[1]!r}</k2><k3>{k[2]!r}</k3><p1>{p2!r}</p1><p2>{p1!r}</p2></calibration></sensor></sensors>"
        f'<components><component id="0" label="C">{transform}</component></components>'
        f"<cameras>{''.join(cameras)}</cameras>{markers}<reference>EPSG:4326</reference></chunk></document>\n"
    )
    return path


def write_bingo(
    path: Path, of: Scene, wrong: str = "", names: list[str] | None = None, height: float = PIXEL_HEIGHT
) -> Path:
    """Write image.dat as Metashape does, photos by `names`, else by those of the scene without blanks."""
    lens, w, h = of.lens, PIXEL_WIDTH, height
    names = names or [name.replace(" ", "_") for name in of.names]
    lines: list[str] = []
    for photo, name in enumerate(names):
        lines.append(f"{name} 1")
        for seen, point, u, v in of.images:
            if seen != photo:
                continue
            u, v = u - lens.width / 2, v - lens.height / 2
            if wrong == "about principal point":
                u, v = u + lens.width / 2 - lens.cx, v + lens.height / 2 - lens.cy
            if wrong in ("no distortion", "initial"):
                a, b = undistorted(lens, u + lens.width / 2, v + lens.height / 2)
                u, v = lens.cx - lens.width / 2 + lens.fx * a, lens.cy - lens.height / 2 + lens.fy * b
                if wrong == "initial":
                    u, v = a * FOCAL_LENGTH / w, b * FOCAL_LENGTH / h
            x, y = u * w, -v * h
            x, y = {
                "y down": (x, -y),
                "x up": (y, -x),
                "x left": (-x, -y),
                "x down": (-y, x),
                "micrometres": (1000.0 * x, 1000.0 * y),
                "pixels": (u, -v),
            }.get(wrong, (x, y))
            lines.append(f" tie_point_number_{point} {x:.9f} {y:.9f}")
        lines.append("-99")
    path.write_text("\n".join(lines) + "\n")
    return path


def undistorted(lens: Lens, u: float, v: float) -> tuple[float, float]:
    """Return the ray of a pixel."""
    x, y = a, b = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    for _ in range(80):
        p, q = lens.bent(x, y)
        x, y = x + a - p, y + b - q
    return x, y
