"""The lower bounds of the dependencies hold: a job, pictures, page and layers with the oldest packages allowed."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DEVELOPERS = ("test", "benchmark")  # extras without a part in what the program does
NO_INDEX = re.compile(r"NewConnectionError|Failed to establish|ConnectTimeout|Name or service|from versions: none")


def bounds(requirements: list[str]) -> dict[str, str]:
    """Return the oldest version that is allowed of each package, with its extras in brackets."""
    found = (re.match(r"([\w.-]+(?:\[\w+\])?)>=([\d.]+)", text) for text in requirements)
    return {match[1]: match[2] for match in found if match}


def users() -> dict[str, str]:
    extras = PROJECT["optional-dependencies"]
    lists = [PROJECT["dependencies"], *(extras[name] for name in extras if name not in DEVELOPERS)]
    assert sum(map(len, lists)) == sum(len(bounds(one)) for one in lists)  # each has one
    return {name: version for one in lists for name, version in bounds(one).items()}


def test_a_package_has_one_bound() -> None:
    """Those for development too."""
    extras = PROJECT["optional-dependencies"].values()
    for one in [PROJECT["dependencies"], *extras]:
        for name, version in bounds(one).items():
            assert users().get(name, version) == version, name


@pytest.fixture(scope="module")
def oldest(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `musat` of an environment of the lower bounds; what these need besides is as new as may be."""
    if sys.version_info >= (3, 13):
        pytest.skip("the oldest packages allowed have no wheels for this Python")
    folder = tmp_path_factory.mktemp("oldest")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, timeout=120)
    pins = [f"{name}=={version}" for name, version in users().items()]
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install", "-q", "--no-input"]
    pip += ["--no-compile", "--only-binary", ":all:"]
    for more in (["--retries", "1", *pins], ["--no-deps", str(wheel)]):
        ran = subprocess.run([*pip, *more], capture_output=True, text=True, timeout=600)
        if ran.returncode and NO_INDEX.search(ran.stderr):
            pytest.skip(f"no package index can be reached: {ran.stderr.strip().splitlines()[-1][:200]}")
        assert ran.returncode == 0, ran.stderr
    return folder / "bin" / "musat"


@pytest.mark.slow
def test_the_job_of_the_readme_with_the_oldest_packages(oldest: Path, tmp_path: Path) -> None:
    def musat(*arguments: str | Path) -> str:
        ran = subprocess.run([oldest, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert ran.returncode == 0, ran.stderr
        assert "unexpected" not in ran.stderr and "Error" not in ran.stderr, ran.stderr
        return ran.stdout

    musat("example", "st_thomas", "-o", "job")
    said = musat("run", "job/st_thomas.crd", "--html", "--plots", "--gis")
    assert "ACCEPTED" in said and "pictures" in said and "layers job/st_thomas.gpkg" in said
    listing = (tmp_path / "job" / "st_thomas.lst").read_bytes()
    assert listing == (ROOT / "fixtures" / "st_thomas" / "st_thomas.lst").read_bytes()
    assert (tmp_path / "job" / "st_thomas.plan.svg").stat().st_size > 10_000
    assert "<figure" in (tmp_path / "job" / "st_thomas.html").read_text()
    compiled = ("as11", "compile", "job/st_thomas.json", "job/st_thomas_as11.crd", "-o", "out", "--gis", "--las")
    assert "257 points" in musat(*compiled)
    assert {"st_thomas_as11.gpkg", "st_thomas_as11.dxf", "st_thomas_as11.las"} <= set(os.listdir(tmp_path / "out"))
