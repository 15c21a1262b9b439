"""Tables 4 to 8 and Figures 7 to 9 of Okamoto (1982), computed: the page, the CSV and the pictures in docs.

Run it after a change that moves numbers; pictures need the extra `plots`.
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from musatpy.sea.experiment import MappingErrors, histogram, run, spread
from studies import okamoto

ROOT = Path(__file__).parents[2]
PRINTED = ROOT / "fixtures" / "okamoto" / "tables4to8.csv"
PAGE = ROOT / "docs" / "okamoto_tables.md"
TABLE = ROOT / "docs" / "studies" / "okamoto.csv"
PICTURES = ROOT / "docs" / "pictures"
WITHIN = 0.01  # m

# (table, flying height, depth, mode, coordinate) -> what is misprinted
MISPRINTED_NUMBER = {(6, 1500, 20, "A", "Y"): "No. 140 is 147"}
MISPRINTED_SIGMA = {
    (8, 1500, 20, "B", "X"): "sigma .11 is .16",
    (8, 500, 5, "B", "Z"): "sigma .62 is .60",
}
CORRECTED_NUMBER = {(6, 1500, 20, "A", "Y"): 147}


@dataclass(frozen=True)
class Cell:
    """One printed cell and what is computed for it: |error| at the printed point number, and sigma (m)."""

    key: tuple[int, int, int, str, str]
    no: int
    printed_maximum: float
    printed_sigma: float
    maximum: float
    sigma: float
    largest: float  # of all points, and its number
    largest_no: int

    @property
    def maximum_agrees(self) -> bool:
        return abs(self.maximum - self.printed_maximum) <= WITHIN

    @property
    def sigma_agrees(self) -> bool:
        return abs(self.sigma - self.printed_sigma) <= WITHIN

    @property
    def misprint(self) -> str:
        return MISPRINTED_NUMBER.get(self.key) or MISPRINTED_SIGMA.get(self.key, "")


@cache
def errors_of(table: int, flying_height: int, depth: int, mode: str) -> MappingErrors:
    return run(okamoto.experiment(table, flying_height, depth, mode == "A"))


def printed_rows() -> list[dict[str, str]]:
    with PRINTED.open(newline="") as file:
        return list(csv.DictReader(file))


def cells() -> list[Cell]:
    """Return the legible cells in the order of the paper."""
    found = []
    for row in printed_rows():
        if not row["emax"]:
            continue
        key = (int(row["table"]), int(row["height"]), int(row["h"]), row["mode"], row["coord"])
        error = errors_of(*key[:4]).error
        axis, sizes = "XYZ".index(row["coord"]), spread(error)
        found.append(
            Cell(
                key=key,
                no=int(row["no"]),
                printed_maximum=float(row["emax"]),
                printed_sigma=float(row["sigma"]),
                maximum=float(abs(error[int(row["no"]) - 1, axis])),
                sigma=float(sizes.sigma[axis]),
                largest=float(abs(sizes.largest[axis])),
                largest_no=int(sizes.point[axis]) + 1,
            )
        )
    return found


def largest_difference(all_cells: list[Cell]) -> tuple[float, float]:
    """Return the largest differences (m) of maxima and of standard errors, misprints apart."""
    maxima = [abs(c.maximum - c.printed_maximum) for c in all_cells if c.key not in MISPRINTED_NUMBER]
    return max(maxima), max(abs(c.sigma - c.printed_sigma) for c in all_cells if c.key not in MISPRINTED_SIGMA)


def page() -> str:
    """Return the page of docs."""
    all_cells = cells()
    count = len(all_cells)
    maximum = sum(cell.maximum_agrees for cell in all_cells)
    sigma = sum(cell.sigma_agrees for cell in all_cells)
    off = [cell for cell in all_cells if not (cell.maximum_agrees and cell.sigma_agrees)]
    worst = max(largest_difference(all_cells))
    return "\n".join(
        [
            *_HEAD,
            f"Of {count} legible cells, {maximum} maxima ({100 * maximum / count:.1f} %) and {sigma} sigmas",
            f"({100 * sigma / count:.1f} %) agree within {WITHIN} m; apart from the misprints, "
            f"the largest difference is {worst:.3f} m.",
            "Those that do not agree:",
            "",
            *(f"- {_where(cell)}: {_difference(cell)}" for cell in off),
            "",
            *_MISPRINTS,
            "",
            *_INPUTS,
            "",
            *_FIGURES,
        ]
    )


def _where(cell: Cell) -> str:
    table, height, depth, mode, coordinate = cell.key
    return f"Table {table}, {height} m, h = {depth} m, {mode}, {coordinate}"


def _difference(cell: Cell) -> str:
    said = []
    if not cell.maximum_agrees:
        said.append(f"maximum {cell.printed_maximum:.2f} printed, {cell.maximum:.3f} computed at No. {cell.no}")
    if not cell.sigma_agrees:
        said.append(f"sigma {cell.printed_sigma:.2f} printed, {cell.sigma:.3f} computed")
    return "; ".join(said) + (f" (misprint: {cell.misprint})" if cell.misprint else "")


def table() -> str:
    """Return the cells as CSV: as printed, as computed, and what is misprinted."""
    lines = ["table,flying_height,depth,mode,coordinate,no,maximum_printed,maximum,sigma_printed,sigma,misprint"]
    for cell in cells():
        numbers = [
            f"{cell.printed_maximum:.2f}",
            f"{cell.maximum:.3f}",
            f"{cell.printed_sigma:.2f}",
            f"{cell.sigma:.3f}",
        ]
        lines.append(",".join([*map(str, cell.key), str(cell.no), *numbers, _remark(cell)]))
    return "\n".join(lines) + "\n"


def _remark(cell: Cell) -> str:
    number = CORRECTED_NUMBER.get(cell.key)
    if number is None:
        return cell.misprint
    value = abs(errors_of(*cell.key[:4]).error[number - 1, "XYZ".index(cell.key[4])])
    return f"{cell.misprint}: {value:.3f}"


_HEAD = """\
# Tables 4 to 8 of Okamoto (1982), printed and computed

Errors of a map that takes waves for level water: largest and standard errors (m) of 231 check points, from flying
heights H + h above a bottom in depth h; mode A is simultaneous photography, B is not. Printed and computed values
of every cell stand in [studies/okamoto.csv](studies/okamoto.csv); `python -m drivers.okamoto_tables` computes them.
The maximum is compared at the printed point number, because 14 printed maxima are exceeded elsewhere by more than
0.01 m.

""".splitlines()

_MISPRINTS = """\
Further misprints: in Table 5 the second row "X" (h = 5 m, A, 500 m) is Y, and the second "1Xw = 166" (h = 20 m, B,
1500 m) is 2Xw; Table 7 lost the phases of the short wave (h = 5 m, B: 5 to 20 and 5 to 50) and the two cells in Z
there, which are left out.
""".splitlines()

_INPUTS = """\
What the paper states: flying heights, bases (264 m, 800 m), direction of the waves (30 degrees), index (1.333),
number of check points, wave lengths, phases. Deduced from the tables: the check points lie in 11 rows
along X and 21 along Y, an eighth of the base apart, numbered along Y first; the origin of ground and waves is the
middle of the first row. Inferred by fit, and not in the paper:

| | X, Y, height above the origin (m) |
|---|---|
| cameras, 500 m | (30, -30, 25), (310, 15, -10) |
| cameras, 1500 m | (130, -40, -30), (880, 15, 45) |

| amplitude (m) | h = 5 m | 10 m | 20 m |
|---|---:|---:|---:|
| T = 10 s | 0.55 (inferred; half of 1.11 printed) | 0.49 | 0.47 (inferred; half of 0.92 printed) |
| T = 15 s | 1.30 (inferred; half of 2.65 printed) | 1.14 | 1.00 |
| T = 4 s | 0.14 | 0.15 (inferred; half of 0.29 printed) | 0.15 |
""".splitlines()

_FIGURES = """\
## Figures 7, 8 and 9

Figure 7, several refraction points of one point, here 20 m below waves 7 m long and 0.7 m high, and
2.5 m long and 0.28 m high (the paper gives no numbers):

![Rays from one point through short waves](pictures/okamoto_figure7.png)

Figures 8 and 9, the errors in height in depth 20 m from 1500 m, simultaneous photography: a long wave of 2.0 m and
15 s, a short one of 0.3 m and 4 s. They are spread evenly about zero, but not normally.

![Histogram, long wave](pictures/okamoto_figure8.png)

![Histogram, short wave](pictures/okamoto_figure9.png)
""".splitlines()


def pictures() -> dict[str, bytes]:
    """Return Figures 7, 8 and 9 as PNG files, by name."""
    from musatpy.refraction.waves import sinusoidal
    from studies.crossing import crossing
    from studies.pictures import height_histogram, refraction_picture

    waves = sinusoidal(amplitude=[0.35, 0.14], length=[7.0, 2.5], azimuth=0.0)
    section = crossing(waves, np.array([-60.0, 0.0, 480.0]), np.array([0.0, 0.0, -20.0]), okamoto.INDEX, 8.0)
    long_wave, short_wave = (histogram(errors_of(table, 1500, 20, "A").error) for table in (5, 6))
    case = "h = 20 m, H + h = 1500 m"
    return {
        "okamoto_figure7": refraction_picture(section, "Refraction points of one point under short waves"),
        "okamoto_figure8": height_histogram(long_wave, f"Long wave: 2.0 m, 15 s; {case}"),
        "okamoto_figure9": height_histogram(short_wave, f"Short wave: 0.3 m, 4 s; {case}"),
    }


def main() -> None:
    PAGE.write_text(page() + "\n", encoding="utf-8")
    TABLE.write_text(table(), encoding="utf-8")
    PICTURES.mkdir(exist_ok=True)
    for name, picture in pictures().items():
        (PICTURES / f"{name}.png").write_bytes(picture)


if __name__ == "__main__":
    main()
