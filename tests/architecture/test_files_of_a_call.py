"""How many files one call passes: whoever follows an adjustment has to know no more of them."""

import subprocess
import sys
from pathlib import Path

import pytest

FIXTURES = Path(__file__).parents[2] / "fixtures"
MOST = {"cayman_standard": 25, "cayman_clean": 28, "cayman_modified": 28}  # with WATPT three more
# Files in which a function runs while a block is adjusted: no body of a module, and nothing that an import calls.
CALL = """
import sys
import musatpy

source, files = musatpy.__path__[0], set()


def is_of_import(frame):
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_code.co_filename.startswith(source):
            return True
        frame = frame.f_back
    return False


def note(frame, event, argument):
    if event == "call" and frame.f_code.co_filename.startswith(source) and not is_of_import(frame):
        files.add(frame.f_code.co_filename)


adjust = musatpy.adjust
for deck in sys.argv[1:]:
    block = musatpy.read_deck(deck)
    files.clear()
    sys.setprofile(note)
    adjust(block)
    sys.setprofile(None)
    print(len(block.photos.ids), *sorted(files))
"""


@pytest.mark.slow
def test_an_adjustment_of_ten_photos_passes_few_files() -> None:
    paths = [str(FIXTURES / "cayman" / f"{deck}.crd") for deck in MOST]
    ran = subprocess.run([sys.executable, "-c", CALL, *paths], capture_output=True, text=True, check=True)
    for most, line in zip(MOST.values(), ran.stdout.splitlines(), strict=True):
        photos, *files = line.split()
        assert photos == "10"
        assert any(file.endswith("pipeline.py") for file in files)
        assert len(files) <= most, "\n".join(files)
