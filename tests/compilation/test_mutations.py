"""Signs and constants of loop, modes, datum and statistics, each made wrong in a copy of the program.

A change that no test of its room notices has no test. Where the tests before it take long, the one that notices a
change is named.
"""

from __future__ import annotations

import compileall
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import cache_from_source
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOOP, PRINTED = "compilation/test_loop.py", "compilation/test_printed.py"
POINTS = "compilation/test_true_points.py"
PAIRS, PARALLAXES = "compilation/test_pair_points.py", "compilation/test_parallax_tests.py"
WAVES = "compilation/test_runs_with_waves.py"
THROUGH_WAVES = f"{WAVES}::test_stages_and_marks_are_inverse_through_waves"
OF_WAVES = f"{WAVES}::test_errors_of_a_wave_are_in_the_sigmas"
LOST = f"{WAVES}::test_under_waves_short_beside_the_depth_points_are_lost_with_a_reason"
CHAINS, VIEWS = "compilation/test_stage_chains.py", "compilation/test_views_of_points.py"
PARTIALS = f"{CHAINS}::test_partials_of_raw_stages"
PATHS = f"{CHAINS}::test_a_path_may_be_in_the_system_of_the_job"
REMARKS = f"{VIEWS}::test_remarks_say_why_there_is_no_depth_and_angles_are_those_of_wet_rays"
LAGS, SCANS, LEVELS = "surfaces/test_lags.py", "compilation/test_profile_scans.py", "compilation/test_levels.py"
DATUM_GRIDS = f"{LEVELS}::test_depths_below_a_datum_in_a_grid_file"
POSTS = "surfaces/test_grid_contours.py"
CORRECTING, STREAMS = "compilation/test_correcting.py", "compilation/test_correction_streams.py"
FIELDS, BOTTOMS = "compilation/test_correction_fields.py", "compilation/test_raster_bottoms.py"
RASTERS = "compilation/test_raster_contours.py"
DIFFERENCES, AGAINST = "soundings/test_differences.py", "compilation/test_against_run.py"

MUTATIONS = [
    # the loop
    ("compilation/stereomodels.py", "tilt @ self.run.frame", "-tilt @ self.run.frame", LOOP),
    ("compilation/loop.py", "by_v @ stereo.axes @ by_mark", "by_v @ by_mark", THROUGH_WAVES),
    ("compilation/loop.py", "xy[active] - now.xy", "now.xy - xy[active]", LOOP),
    ("compilation/loop.py", "Water(index=stereo.index", "Water(index=1.333", LOOP),
    ("compilation/loop.py", "_STILL = 1e-7", "_STILL = 1e-2", THROUGH_WAVES),
    ("compilation/loop.py", "np.tile(stereo.photos", "np.tile(stereo.photos[::-1]", OF_WAVES),
    ("compilation/loop.py", "np.tile(stereo.tides", "np.tile(stereo.tides[::-1]", OF_WAVES),
    ("compilation/triangulation.py", "sea.trains.with_values(adjusted).surface", "sea.surface", WAVES),
    ("compilation/true_points.py", "participation(block), run.sea", "participation(block), None", WAVES),
    ("compilation/triangulation.py", "and self.sea.considered", "and not self.sea.considered", WAVES),
    ("compilation/run_records.py", "given | dict(zip", "dict(zip", WAVES),
    ("compilation/correcting.py", "xy[left > _STILL] = np.nan", "xy[left > _STILL] *= 1.0", LOST),
    ("compilation/stereomodels.py", "np.cross(up, x)", "np.cross(x, up)", LOOP),
    ("compilation/stereomodels.py", "self.run.block.photos.tide[list(self.photos)]",
     "self.run.block.photos.tide[list(self.photos)][::-1]", LOOP),
    ("compilation/model_points.py", "[-1.0, 1.0]", "[1.0, -1.0]", "compilation/test_model_points.py"),
    ("compilation/model_points.py", "0.5 * np.nan_to_num", "np.nan_to_num", "compilation/test_model_points.py"),
    # raw stages
    ("compilation/stage_chains.py", "for step in reversed(steps)", "for step in steps", CHAINS),
    ("compilation/stage_chains.py", "H = step.matrix() @ H", "H = H @ step.matrix()", CHAINS),
    ("compilation/stage_chains.py", "_ONE + step.distortion_partials", "_ONE - step.distortion_partials", CHAINS),
    ("compilation/stage_chains.py", "_backwards(step, before, xy) @ partials", "partials", CHAINS),
    ("compilation/stage_chains.py", "by_plate @ refined.by_mark", "refined.by_mark", PARTIALS),
    ("compilation/stage_chains.py", "(plane - read[..., None]", "(plane + read[..., None]", CHAINS),
    ("reduction/nadir.py", "scale = 1.0 - down", "scale = 1.0 + down", CHAINS),
    ("reduction/nadir.py", "squared / t - t)", "squared / t + t)", CHAINS),
    ("compilation/driving.py", "path[:, 1:] * unit", "path[:, 1:]", PATHS),
    # the points
    ("compilation/views_of_points.py", "-np.einsum", "np.einsum", REMARKS),
    ("compilation/views_of_points.py", "submerged & (wet.sum(axis=1) == 1)", "submerged & (wet.sum(axis=1) == 2)",
     REMARKS),
    ("compilation/views_of_points.py", "(off, PARALLAX)", "(~off, PARALLAX)", REMARKS),
    ("compilation/answers.py", "np.swapaxes(rates, 1, 2)", "rates", VIEWS),
    ("compilation/answers.py", "coordinates_of(system, apparent)", "coordinates_of(system, place)", VIEWS),
    ("compilation/setups.py", "np.square(self.sigma[:, 2]) - np", "np.square(self.sigma[:, 2]) + np",
     "compilation/test_setups.py"),
    # profiles, their lag and their pace
    ("surfaces/lags.py", "-2.0 * direction", "2.0 * direction", LAGS),
    ("surfaces/lags.py", "-2.0 * direction", "-1.0 * direction", LAGS),
    ("surfaces/lags.py", "np.array([-0.5, 1.0, -0.5])", "np.array([-0.5, 1.0, 0.5])", LAGS),
    ("surfaces/lags.py", "share[place :", "share[0 * place :", LAGS),
    ("surfaces/profiles.py", "np.square(1.0 - part) * variance[after - 1]", "variance[after - 1]", SCANS),
    ("compilation/profiles.py", "places[:, 2] = height", "places[:, 2] = -height", SCANS),
    ("compilation/profiles.py", "off = sign * (xy", "off = (xy", SCANS),
    ("compilation/profiles.py", "+ sign * number * spacing", "- sign * number * spacing", SCANS),
    ("compilation/profiles.py", "1 if line.line % 2 else -1", "-1 if line.line % 2 else 1", SCANS),
    ("compilation/profiles.py", "station[last] - self.profile.station[first]",
     "station[first] - self.profile.station[last]", SCANS),
    ("compilation/profiles.py", "axis=2).max(axis=1)", "axis=2).min(axis=1)", SCANS),
    ("formats/compilation_deck.py", "int(first) - 1 + known", "int(first) + known - 2", SCANS),
    # levels and the datum in a grid
    ("compilation/datums.py", "height[known] += ", "height[known] -= ", DATUM_GRIDS),
    ("compilation/joined_surfaces.py", "datum.over(at_zero) - depth", "datum.over(at_zero) + depth", LEVELS),
    ("compilation/joined_surfaces.py", "depth >= -spec.drying", "depth >= spec.drying", LEVELS),
    ("surfaces/grid_contours.py", "xy[::-1]", "xy", POSTS),
    ("surfaces/grid_contours.py", "corner[1] + spacing", "corner[1] - spacing", POSTS),
    # the modes
    ("compilation/printed.py", "/ index  # (5.7)", "* index  # (5.7)", PRINTED),
    ("compilation/printed.py", "r = -(tangent", "r = (tangent", PRINTED),
    ("compilation/printed.py", "a = W - r", "a = W + r", PRINTED),
    ("compilation/printed.py", "c13_23, c1_2 = -r.sum", "c13_23, c1_2 = r.sum", PRINTED),
    ("compilation/printed.py", "c3 = np.sum(np.square(r), axis=(1, 2)), -np.sum",
     "c3 = np.sum(np.square(r), axis=(1, 2)), np.sum", PRINTED),
    ("compilation/printed.py", "(c3 - 0.5", "(c3 + 0.5", PRINTED),
    ("compilation/printed.py", "local[:, 2] -= height", "local[:, 2] += height", PRINTED),
    ("compilation/printed.py", "model.tides.mean()", "model.tides.max()", PRINTED),
    ("compilation/errors_of_pairs.py", "row % 2 == 0", "row % 2 == 1 and row < 3", PAIRS),
    ("compilation/errors_of_pairs.py", "= covariance\n", "= -covariance\n", POINTS),
    ("compilation/errors_of_pairs.py", "1.0 / network.weight", "2.0 / network.weight", PAIRS),
    ("compilation/errors_of_pairs.py", "off = -np.einsum", "off = np.einsum", PAIRS),
    ("compilation/errors_of_pairs.py", "np.argmax(piece", "np.argmin(piece", PAIRS),
    ("compilation/parallax_tests.py", "pointing - share", "pointing + share", PARALLAXES),
    ("compilation/parallax_tests.py", "scale * points", "points", PARALLAXES),
    ("compilation/parallax_tests.py", "if not sigma_of_run", "if sigma_of_run", PARALLAXES),
    ("compilation/parallax_tests.py", "np.square(np.maximum(share, 0.0))", "np.maximum(share, 0.0)", PARALLAXES),
    ("probability.py", "8.0 * n + 1.0", "8.0 * n + 9.0", PARALLAXES),
    # many points of a pair
    ("compilation/bent_rays.py", "v=(ex * Q - ux * H", "v=(ex * Q + ux * H", PAIRS),
    ("compilation/bent_rays.py", "(n * n) * h * (g2", "h * (g2", LOOP),
    ("compilation/bent_rays.py", "self.tilt * along - ratio", "-self.tilt * along - ratio", LOOP),
    ("compilation/bent_rays.py", "scale * b + k * q", "scale * b - k * q", LOOP),
    ("geometry/geodesy.py", "off_axis - (square * a)", "off_axis + (square * a)", "geometry/test_frames.py"),
    ("geometry/geodesy.py", "z * sine - a * (1.0", "z * sine + a * (1.0", "geometry/test_frames.py"),
    ("compilation/pair_images.py", "(self.Q_h - self.Q_H)", "(self.Q_h + self.Q_H)", PAIRS),
    ("compilation/pair_images.py", "Q_n=ray.tilt", "Q_n=-ray.tilt", PAIRS),
    ("compilation/pair_images.py", "(self.ratio - 1.0) * up", "self.ratio * up", PAIRS),
    ("compilation/pair_images.py", "+ self.Q_H * along", "- self.Q_H * along", PAIRS),
    ("compilation/pair_images.py", "up + self.Q_h * along", "up - self.Q_h * along", PAIRS),
    ("compilation/pair_images.py", "side.M[2] @ X < side", "side.M[2] @ X > side", PAIRS),
    ("compilation/pair_errors.py", "by_angle[:2] - ratio", "by_angle[:2] + ratio", PAIRS),
    ("compilation/pair_errors.py", "- dot(by_station, cross(omega", "+ dot(by_station, cross(omega", PAIRS),
    ("compilation/pair_errors.py", "turning + by_level", "turning - by_level", PAIRS),
    ("compilation/pair_errors.py", "depth -= 2.0", "depth += 2.0", PAIRS),
    ("compilation/pair_errors.py", "share = 0.5 *", "share = 1.0 *", PAIRS),
    ("compilation/pair_errors.py", "levels[np.maximum(group, 0)]", "levels[np.maximum(group[::-1], 0)]", PAIRS),
    ("compilation/pair_errors.py", "np.swapaxes(out[:2, 2:], 0, 1)", "out[:2, 2:]", PAIRS),
    ("compilation/pair_errors.py", "np.square(null) / weight", "np.square(null) * weight", PAIRS),
    ("compilation/pair_errors.py", "parallax=-einsum", "parallax=einsum", PAIRS),
    ("compilation/pair_errors.py", "X, off = X + move", "X, off = X - move", PAIRS),
    ("compilation/pair_points.py", "& ~near)", ")", PAIRS),
    ("compilation/loop.py", "if depth > 0.0", "if depth > 9.0", LOOP),
    ("compilation/loop.py", "over.depth > 0.0", "over.depth > 9.0", LOOP),
    ("compilation/loop.py", "+ slope @ stereo.origin", "- slope @ stereo.origin", PAIRS),
    ("compilation/errors_of_differences.py", "(c, t, -1.0), (t, c, -1.0)", "(c, t, 1.0), (t, c, 1.0)", AGAINST),
    ("compilation/errors_of_differences.py", "(2.0 * t.alone if", "(0.0 * t.alone if", AGAINST),
    # the datum
    ("compilation/compiled.py", "self.datum.over(self.gathered(\"position\")) - self", "-self", LEVELS),
    ("compilation/compiled.py", "np.hypot(self.sigma[:, 2], self.datum.sigma)", "self.sigma[:, 2]", LEVELS),
    ("compilation/sounded.py", "soundings.depth[met] + how.datum", "soundings.depth[met] - how.datum",
     "compilation/test_sounded.py"),
    ("compilation/sounded.py", "at.slope[met] * how.plan_sigma", "0.0 * at.slope[met] * how.plan_sigma",
     "compilation/test_sounded.py"),
    ("compilation/sounded.py", "np.full(len(met), how.datum_sigma)", "np.zeros(len(met))",
     "compilation/test_sounded.py"),
    # the statistics
    ("soundings/differences.py", "return self.compiled - self.sounded", "return self.sounded - self.compiled",
     DIFFERENCES),
    ("soundings/differences.py", "_NORMAL = 1.4826", "_NORMAL = 1.4", DIFFERENCES),
    ("soundings/differences.py", "_BLUNDER = 3.29", "_BLUNDER = 2.58", DIFFERENCES),
    ("soundings/differences.py", "(len(v) - 2)", "len(v)", DIFFERENCES),
    ("soundings/differences.py", "correlation = Q[0, 1]", "correlation = -Q[0, 1]", DIFFERENCES),
    ("soundings/differences.py", "_SHARE = 0.95", "_SHARE = 0.90", DIFFERENCES),
    ("soundings/differences.py", "size <= order.vertical", "size >= order.vertical", DIFFERENCES),
    ("soundings/differences.py", "1.0 / 0.3048: ", "3.9: ", DIFFERENCES),
    ("soundings/s44.py", "1.960, 2.448", "1.960, 1.960", DIFFERENCES),
    ("soundings/s44.py", "1.960, 2.448", "1.645, 2.448", DIFFERENCES),
    ("soundings/s44.py", "np.hypot(self.a, self.b", "np.hypot(self.b, self.a", DIFFERENCES),
    ("soundings/s44.py", "self.c + self.e", "self.c - self.e", DIFFERENCES),
    ("soundings/s44.toml", "b = 0.0075", "b = 0.0085", DIFFERENCES),
    # old compilations, rasters and files
    ("compilation/correction_rasters.py", "place[active] -= gap", "place[active] += gap", CORRECTING),
    ("compilation/correction_rasters.py", "_TURNS = 3", "_TURNS = 1", CORRECTING),
    ("compilation/correction_rasters.py", "+ posts.spacing * low", "+ posts.spacing * first", STREAMS),
    ("compilation/correction_rasters.py", "if not outside:", "if True:", STREAMS),
    ("compilation/correction_fields.py", "_FADED = 1e-2", "_FADED = 30.0", FIELDS),
    ("compilation/misplaced_points.py", "(longitude + 180.0)", "(longitude + 160.0)", CORRECTING),
    ("compilation/raster_bottoms.py", "(d01 - d00) + v", "(d00 - d01) + v", BOTTOMS),
    ("compilation/raster_bottoms.py", "/ step[1]", "/ self.posts.spacing", BOTTOMS),
    ("compilation/raster_bottoms.py", "u * (1.0 - v), (1.0 - u) * v", "(1.0 - u) * v, u * (1.0 - v)", BOTTOMS),
    ("compilation/raster_contours.py", "wish.datum - values", "values - wish.datum", RASTERS),
    ("compilation/raster_contours.py", "heights = datum - levels", "heights = datum + levels", RASTERS),
    ("compilation/contoured.py", "-1.0 if of == OTHER", "1.0 if of == OTHER", "compilation/test_contoured.py"),
    ("soundings/contour_distances.py", "> farthest", "< farthest", "compilation/test_contoured.py"),
    ("interchange/dxf_tags.py", "xyz[:, 2] = elevation", "xyz[:, 2] = -elevation", "interchange/test_dxf.py"),
    ("interchange/dxf_tags.py", "230: 1.0}", "230: -1.0}", "interchange/test_dxf.py"),
    ("interchange/geotiff.py", "rows - last", "first", "interchange/test_geotiff.py"),
    ("interchange/geotiff.py", "(dataset.height - 0.5)", "dataset.height", "interchange/test_geotiff.py"),
]  # fmt: skip


@dataclass(frozen=True)
class Copy:
    """A copy of the program, and the process that runs tests with it in the place of the program."""

    folder: Path
    process: subprocess.Popen[str]
    environment: dict[str, str]
    loaded: frozenset[str]  # modules of the program that the process does not read again

    def outcome(self, *tests: str, which: str = "", file: str = "") -> tuple[int, str]:
        """Return the status of tests, and what they print; they end with the first that fails.

        A `file` of the program that was altered, and that the process has loaded, needs a process of its own.
        """
        printed = self.folder / "printed"
        options = ("-x", "-q", "-m", which, "-p", "no:cacheprovider", "-p", "no:xdist")
        places = [f"tests/{name}" for name in tests]
        arguments = [*options, "-o", "addopts=--import-mode=importlib", *places]
        if f"musatpy.{file.removesuffix('.py').replace('/', '.')}" in self.loaded:
            command = [sys.executable, "-m", "pytest", *arguments]
            alone = subprocess.run(command, cwd=ROOT, env=self.environment, capture_output=True, text=True)
            return alone.returncode, alone.stdout
        words = [str(printed), *arguments]
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write("\t".join(words) + "\n")
        self.process.stdin.flush()
        return int(self.process.stdout.readline()), printed.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Copy]:
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT / "src" / "musatpy", folder / "musatpy", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "card_formats", folder / "musatpy" / "card_formats")
    compileall.compile_dir(folder, quiet=2)  # once: of each mutation only the changed file is compiled anew
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, str(Path(__file__).with_name("warm_tests.py"))]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        yield Copy(folder, process, environment, frozenset(process.stdout.readline().split()))


@pytest.mark.slow
def test_the_copy_passes_as_it_is(copy: Copy) -> None:
    status, printed = copy.outcome(*sorted({tests.partition("::")[0] for *_, tests in MUTATIONS}), which="not slow")
    assert status == 0, printed


@pytest.mark.slow
@pytest.mark.parametrize(("file", "old", "new", "tests"), MUTATIONS)
def test_a_wrong_sign_or_constant_is_noticed(copy: Copy, file: str, old: str, new: str, tests: str) -> None:
    path = copy.folder / "musatpy" / file
    text = path.read_text(encoding="utf-8")
    assert text.count(old) >= 1 and old != new
    path.write_text(text.replace(old, new), encoding="utf-8")
    try:
        assert copy.outcome(tests, file=file)[0] == 1, f"{old} may be {new}"
    finally:
        path.write_text(text, encoding="utf-8")
        Path(cache_from_source(path)).unlink(missing_ok=True)  # of a file as old and as long
