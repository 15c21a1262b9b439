"""The equations of Okamoto and Mori (1974) as they are printed, in the paper's own axes: Z down, (x, y, c)."""

import numpy as np

from orientation.twomedia.geometries import A, B, N, Scene, rotation

Ray = tuple[np.ndarray, np.ndarray]


def refracted(ray: np.ndarray, C: np.ndarray, d: float, plane: tuple[float, float] = (A, B), n: float = N) -> Ray:
    """Return the point of the water Q and the refracted direction of a ray from C: (2) to (9)."""
    gradient = np.array([*plane, 1.0])
    normal, ray = gradient / np.linalg.norm(gradient), ray / np.linalg.norm(ray)
    cosine = ray @ normal
    bent = (ray - normal * (cosine - np.sqrt(n * n - 1.0 + cosine**2))) / n
    return C - (gradient @ C + d) / (gradient @ ray) * ray, bent


def ray_of(scene: Scene, photo: int, point: int, image: np.ndarray | None = None) -> Ray:
    """Return the ray of a point, of another image of it where one is given."""
    xy = scene.images[photo, point] if image is None else image
    return refracted(rotation(*scene.angles[photo]) @ [*xy, scene.kind.c], scene.stations[photo], scene.d)


def volume(first: Ray, second: Ray) -> float:
    """Return |S|: (23), (28), (31) to (33)."""
    return float(np.linalg.det(np.column_stack([first[0] - second[0], first[1], second[1]])))


def distance_in_xy(first: Ray, second: Ray) -> float:
    """Return k of the first ray in components of X and Y: (36), (40), (44)."""
    (P, l1), (Q, l2) = first, second
    return float((l2[0] * (P[1] - Q[1]) - l2[1] * (P[0] - Q[0])) / (l1[0] * l2[1] - l2[0] * l1[1]))


def nine_equations(rays: tuple[Ray, Ray, Ray], third: int = 0) -> np.ndarray:
    """Return (31) to (33) and (46) of a point on three photos.

    The third member of (46) goes along the ray of which (44) gives the distance, that of photo 1; `third` is the
    ray along which it goes.
    """
    first, second, last = rays
    places = [
        first[0] + distance_in_xy(first, second) * first[1],
        second[0] + distance_in_xy(second, last) * second[1],
        rays[third][0] + distance_in_xy(first, last) * rays[third][1],
    ]
    volumes = [volume(first, second), volume(second, last), volume(first, last)]
    return np.concatenate([volumes, places[0] - places[1], places[1] - places[2]])
