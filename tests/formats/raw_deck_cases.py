"""Bad decks of raw plates for their cross checks, made from the fixture by one edit, with their whole reports."""

from pathlib import Path

from formats.bad_deck_cases import Case, Expected, case, warning
from formats.deck_edits import add, deck, drop, replace

RAW = (
    (Path(__file__).parents[2] / "fixtures" / "st_thomas_raw" / "st_thomas_raw.crd")
    .read_text(encoding="ascii")
    .splitlines()
)

X_AXIS = "FDS RC8  7    5      224.00500 0.00300 X"
CROSS = "RSC RC8  A01        1   1  -100.00200   100.00100"
GRID = [
    CROSS,
    "RSC RC8  A02        1   2   100.00200   100.00100",
    "RSC RC8  B01        2   1  -100.00200  -100.00100",
    "RSC RC8  B02        2   2   100.00200  -100.00100",
]
UNMEASURED = warning(79, "PLT.photo", "21", "photo 21, like 2 more, has no measured crosses (RSM)")
CROSS_OF_22 = "RSM 22       A01      -99.9870000 100.0120000"
GO = replace(3, "STOP", "GO  ")


def bad(*edits) -> bytes:
    """Return the deck of the fixture after edits; added cards begin on line 137."""
    return deck(*edits, lines=RAW)


RAW_CASES: list[Case] = [
    case(
        bad(
            replace(3, "US1976 NO ", "US1976 YES"),
            replace(3, "    20.00", " " * 9),
            replace(10, "  0.500000000E+02", " -0.500000000E+02"),
            replace(13, "  -0.00400", " " * 10),
            replace(92, "-135.4841978" + " " * 18, "-135.4841978" + " " * 17 + "N"),
            add("DST RC8  RADL  0.125000000E-07", "DST RC8  DCEN  0.125000000E-07"),
            add("DST RC8  TABL  0.100000000E+03  0.100000000E-02", CROSS_OF_22),
        ),
        "3 RED.curvature [YES] earth curvature belongs to jobs in a grid (LOCL), not to GEOG ones",
        "3 RED.ground_height [] refraction and curvature need the height of the ground",
        "10 DST.value_1 [-0.500000000E+02] a calibrated radius must be greater than zero",
        "13 LNS.y [] needs both x and y, or neither",
        "92 PLT.not_triangulated [N] the reading on line 79 says otherwise",
        "137 DST.kind [RADL] the RADL distortion of camera RC8 is already given on line 8",
        "138 DST.kind [DCEN] the DCEN distortion of camera RC8 is already given on line 9",
        "139 DST.value_1 [0.100000000E+03] the distortion at this radius is already given on line 11",
        "140 RSM.cross [A01] camera RC8 has no calibrated cross at all (RSC)",
    ),
    case(
        bad(replace(3, "AFFINE   ", "DISTANCES")),
        "7 CAM.camera [RC8] camera RC8 has no distances along both axes (X and Y) or both diagonals",
    ),
    case(
        bad(drop(*range(14, 22), *range(31, 79))),
        "7 CAM.camera [RC8] fewer than the 3 calibrated marks of a transformation AFFINE (FID)",
        *(
            Expected(line, "PLT.photo", photo, f"photo {photo} has no measured fiducial marks (FMS)")
            for line, photo in ((23, "21"), (37, "22"), (60, "23"))
        ),
    ),
    case(bad(drop(*range(31, 47))), "63 PLT.photo [21] photo 21 has no measured fiducial marks (FMS)"),
    case(bad(drop(*range(31, 47)), GO), "~63 PLT.photo [21] photo 21 has no measured fiducial marks (FMS)"),
    case(bad(add(CROSS, GRID[1])), UNMEASURED, "137 RSC.camera [RC8] has not two rows and two columns of crosses"),
    (bad(add(*GRID)), [UNMEASURED]),
    case(
        bad(add(*GRID, CROSS_OF_22, "RSM 23       A01      -99.9870000 100.01")),
        "~79 PLT.photo [21] photo 21 has no measured crosses (RSM): its film deformation is not",
    ),
    case(
        bad(add("OP2 COMPUTE"), drop(22)),
        "78 PLT.photo [21] photo 21 has no station card: refraction and curvature need its height",
    ),
    # --- what other checks say of the cards of raw plates ---
    case(
        bad(
            add(
                *(card.replace("RC8", "RC9") for card in (RAW[12][:72], X_AXIS)),
                CROSS.replace("RC8", "RC7"),
                "DST RC6  RADL  0.125000000E-07",
            )
        ),
        "137 LNS.camera [RC9] camera RC9 has no CAM card (1 more card names it)",
        "139 RSC.camera [RC7] camera RC7 has no CAM card",
        "140 DST.camera [RC6] camera RC6 has no CAM card",
    ),
    case(
        bad(
            add(
                *GRID, "RSM 21       B07      -99.9870000 100.0120000", "FMS 21       9    -233.4406974-237.4717361"
            )
        ),
        "~93 PLT.photo [22] photo 22, like 1 more, has no measured crosses",
        "141 RSM.cross [B07] camera RC8 has no calibrated cross B07 (RSC)",
        "142 FMS.mark [9] camera RC8 has no calibrated mark 9 (FID)",
    ),
    # one problem for the 3 x 16 readings of marks of a camera that has none
    case(
        bad(drop(*range(14, 22)), replace(3, "AFFINE   ", "NONE     ")),
        "23 FMS.mark [1] camera RC8 has no calibrated mark at all (FID) (47 more cards name it)",
    ),
]
