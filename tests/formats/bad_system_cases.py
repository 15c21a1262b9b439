"""Bad decks for the checks of the cards that state systems, with their whole reports."""

from dataclasses import replace as with_values

from formats.bad_deck_cases import LOCAL, Case, Expected, case
from formats.deck_edits import GOOD, add, deck, drop
from musatpy.formats import musat
from musatpy.model import SystemSpec
from musatpy.units import AngleUnit


def stated(**words: object) -> list[str]:
    """Return the lines of the good deck in other words."""
    return (
        musat.deck_bytes(with_values(musat.read_deck(deck()), given_in=SystemSpec(**words))).decode().splitlines()
    )


UTM = stated(kind="PROJ", definition="EPSG:26717", axes="GRID")
MATRICES = stated(angles="MATR", unit=AngleUnit.DEGREES)
OUT = "SYS OUT PROJ GRID OPK  DMS SYST "
ROW_2 = next(number for number, line in enumerate(MATRICES, 1) if line[:14] == "MAT 841      2")


def changed(lines: list[str], number: int, first: int, text: str) -> list[str]:
    """Return lines with a text at columns of one of them (both from 1)."""
    line = lines[number - 1]
    return [*lines[: number - 1], line[: first - 1] + text + line[first - 1 + len(text) :], *lines[number:]]


def utm(definition: str) -> list[str]:
    """Return the deck in UTM with another definition on its SYS card, line 4."""
    return changed(UTM, 4, 33, definition.ljust(40))


CASES: list[Case] = [
    case(
        deck(add("SYF OUT         1.0000", "SYT OUT GEOID some.gtx")),
        "49 SYF.role [OUT] no SYS card for OUT, which this one goes with",
        "50 SYT.role [OUT] no SYS card for OUT, which this one goes with",
    ),
    case(deck(add("SYS IN  LOCL"), lines=changed(LOCAL, 2, 10, "GEOC")), "2 OPT.system [GEOC] the SYS card says"),
    # codes, names and strings that PROJ does not know, or that would make it guess
    case(deck(lines=utm("EPSG:99999")), "4 SYS.definition [EPSG:99999] is no coordinate system that PROJ knows"),
    case(deck(lines=utm("UTM zone 17")), "4 SYS.definition [UTM zone 17] is no coordinate system: give its code"),
    case(
        deck(add("SYT IN  PROJ +proj=utm +zone=17 +ellps=clrk66 +towgs84=-8,160,176"), lines=utm("")),
        "50 SYT.text [+proj=utm +zone=17 +ellps=clrk66 +towgs84=-8,160,176] asks for a datum shift",
    ),
    case(deck(lines=utm("EPSG:32617")), "4 SYS.definition [EPSG:32617] is on the ellipsoid WGS 84"),
    case(deck(add("SYT IN  GEOID no/such.gtx"), lines=UTM), "50 SYT.text [no/such.gtx] there is no such file"),
    case(deck(add(OUT)), "49 SYS.definition [] a system of kind PROJ needs it"),
    case(
        deck(add("SYS OUT GEOG", "SYO OUT  19 20  0.00000  -81 10  0.00000", "SYT OUT GEOID x.gtx")),
        "49 SYS [] origin: a system of kind GEOG has none",
        "51 SYT.text [x.gtx] a system of kind GEOG has none",
    ),
    case(deck(add("SYS OUT GEOG GRID")), "49 SYS.axes [GRID] attitudes cannot refer to axes of the system"),
    case(deck(add("SYS OUT GEOC"), lines=LOCAL), "48 SYS.kind [GEOC] a local job stands nowhere on the ellipsoid"),
    case(
        deck(add(*GOOD[8:11]), lines=[line for line in MATRICES if line[:3] not in ("SYS", "MAT")]),
        "6 STD [] angles in decimals, and no SYS card for IN that says their unit",
        "39 CTD [] angles in decimals, and no SYS card for IN that says their unit",
    ),
    case(
        deck(add("MAT 841      1  1.0000000000000  0.0000000000000  0.0000000000000")),
        "49 MAT [] a matrix, and no SYS card for IN that says MATR",
    ),
    case(
        deck(add(*(line for line in MATRICES if line[:7] == "MAT 841")), drop(9)),
        "48 MAT [] a matrix, and no SYS card for IN that says MATR",
    ),
    case(deck(add(GOOD[9]), lines=MATRICES), "56 ATT [] angles, where attitudes are stated as matrices"),
    case(
        deck(add(GOOD[9]), lines=[line for line in MATRICES if line[:7] != "MAT 842"]),
        "53 ATT [] angles, where attitudes are stated as matrices",
    ),
    case(
        deck(lines=changed(MATRICES, ROW_2, 14, "1")),
        Expected(ROW_2 - 1, "MAT.row", "1", "the matrix of photo 841 needs rows 1, 2 and 3, not 1, 1, 3"),
    ),
    case(
        deck(lines=[line for line in MATRICES if line != MATRICES[ROW_2 - 1]]),
        Expected(ROW_2 - 1, "MAT.row", "1", "the matrix of photo 841 needs rows 1, 2 and 3, not 1, 3"),
    ),
]

# What only taking a deck in from its system shows, or stating its answer: problems of no check.
ENTERED: dict[str, tuple[bytes, list[Expected]]] = {
    "words that no card has": case(
        deck(add("SYS IX  UTM  UP   XYZ  RAX SIGM EPSG:26717")),
        "49 SYS.role [IX] ",
        "49 SYS.kind [UTM] ",
        "49 SYS.axes [UP] ",
        "49 SYS.angles [XYZ] ",
        "49 SYS.unit [RAX] ",
        "49 SYS.deviations [SIGM] ",
    ),
    "a station beyond the map": case(
        deck(lines=changed(UTM, 7, 17, " 99467477.8113")),
        Expected(7, "STX", UTM[6][30:57].join([" 99467477.8113", ""]).strip(), "does not reach 99467477.811"),
    ),
    "a station beyond the map of the answer": (
        deck(add("SYS OUT PROJ VERT OPK", "SYT OUT PROJ +proj=gnom +lat_0=-80 +lon_0=99 +ellps=clrk66")),
        [
            *(Expected(line, "STA", GOOD[line - 1][16:57].strip(), "does not reach 19.3") for line in (6, 7, 8)),
            *(Expected(line, "CTG", GOOD[line - 1][16:57].strip(), "does not reach 19.3") for line in (42, 44)),
        ],
    ),
    "places outside the area of the system of the answer": case(
        deck(add(f"{OUT}EPSG:26718")),
        "~49 SYS.definition [EPSG:26718] 5 of the 5 stations and control points lie outside the area",
    ),
    "left-handed axes of attitudes": case(
        deck(add(OUT, "SYT OUT PROJ +proj=utm +zone=17 +ellps=clrk66 +axis=wnu")),
        "49 SYS.axes [GRID] its axes are left-handed",
    ),
    "left-handed axes of given attitudes": case(
        deck(add("SYT IN  PROJ +proj=utm +zone=17 +ellps=clrk66 +axis=wnu"), lines=utm("")),
        "4 SYS.axes [GRID] its axes are left-handed",
    ),
    "no rotation": case(
        deck(lines=changed(MATRICES, ROW_2, 16, " 0.5000000000000")),
        Expected(ROW_2 - 1, "MAT", "", "photo 841: its matrix is no rotation"),
    ),
    "an angle beyond a whole turn": case(
        deck(lines=changed(UTM, 11, 44, "451")), "11 ATT.heading [451 37  6.1205] an angle of 451.6184 degrees is"
    ),
    "a heading that the images contradict": case(
        deck(lines=changed(UTM, 11, 44, " 91")), "~11 ATT.heading [91 37  6.1205] a heading of 92 degrees"
    ),
}
