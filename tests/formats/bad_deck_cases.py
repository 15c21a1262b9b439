"""Bad decks for every cross check, made from a good one by one edit, with their whole reports."""

import re
from dataclasses import dataclass

from formats.deck_edits import FOLDER, GOOD, add, deck, drop, in_system, replace
from musatpy.errors import Problem
from musatpy.formats import musat
from musatpy.model import CoordinateSystem


@dataclass(frozen=True)
class Expected:
    """A problem: its line, `CARD.field`, what stands in its columns, a part of its message, its severity."""

    line: int | None
    where: str
    found: str
    message: str
    severity: str = "error"

    def check(self, problem: Problem) -> None:
        assert problem.severity == self.severity, problem
        assert problem.line == self.line, problem
        assert ".".join(name for name in (problem.card, problem.field) if name) == self.where, problem
        assert self.message in problem.message, problem
        if problem.columns is not None:
            first, last = problem.columns
            assert problem.text.ljust(80)[first - 1 : last].strip() == self.found, problem
        else:
            assert self.found == "", problem


def warning(line: int | None, where: str, found: str, message: str) -> Expected:
    return Expected(line, where, found, message, "warning")


Case = tuple[bytes, list[Expected]]


def case(data: bytes, *report: str | Expected) -> Case:
    """Return a bad deck with its whole report: `line CARD.field [found] part of the message`, a warning after `~`.

    Where a problem has no line, or no card, `-` stands for it.
    """
    return data, [_expected(one) if isinstance(one, str) else one for one in report]


def _expected(text: str) -> Expected:
    found = re.fullmatch(r"(~?)(\d+|-) (\S+) \[(.*?)\] (.*)", text)
    assert found, text
    mark, line, where, cells, message = found.groups()
    severity = "warning" if mark else "error"
    return Expected(None if line == "-" else int(line), where.removeprefix("-"), cells, message, severity)


LOCAL = musat.deck_bytes(in_system(CoordinateSystem.LOCAL)).decode().splitlines()
GEOCENTRIC = musat.deck_bytes(in_system(CoordinateSystem.GEOCENTRIC)).decode().splitlines()


IIIA = replace(2, "IIA ", "IIIA")


def ins(photo: str, first: float = 0.5, second: float = -1.5, third: float = 89.0, sigma: float = 10.0) -> str:
    """Return the card of an inertial attitude, the sigma that about x."""
    return f"INS {photo:8}{first:14.8f}{second:14.8f}{third:14.8f}{sigma:6.1f}  10.0  20.0"


def mis(camera: str, angle: float = 0.5, sigma: str = "", free: str = "") -> str:
    """Return the card of a misalignment, angle and sigma those of omega."""
    return f"MIS {camera:5}{angle:14.8f}{0.25:14.8f}{-0.5:14.8f}{sigma:6}{sigma:6}{sigma:6} {free}"


def plates_a_thousandth(lines: list[str]) -> list[str]:
    """Return the deck with its plates in metres, as if these were millimetres."""

    def smaller(text: str) -> str:
        return f"{float(text[21:33]) / 1e3:12.7f}{float(text[33:45]) / 1e3:12.7f}"

    return [text[:21] + smaller(text) + text[45:] if text[:3] == "PLT" else text for text in lines]


STA = "STA 841     RC8  19 21  0.00000 -81 18 36.00000 1500.0000"
STX = "STX 844     RC8      1000.0000      100.0000    1500.0000"

COMPUTE = "OP2 COMPUTE"
IIIA = replace(2, "OPT IIA  GEOG WATPT   ", "OPT IIIA GEOG RIGOROUS")


LOOSE = replace(42, "0.1000.1000.100", " " * 15)


def covariances(point: str, first: str = "0.200000") -> str:
    """Return a card of covariances."""
    return f"CTC {point:<8}  0.015000  0.012000  0.031000 {first:>9} -0.150000  0.300000"


def port(camera: str, distance: float, thickness: float, glass: float, water: float, *tilts: float) -> str:
    """Return a card of a flat port."""
    sizes = f"{distance:9.3f}{thickness:9.3f}{glass:9.5f}{water:9.5f}"
    return f"PRT {camera} {sizes}" + "".join(f"{tilt:9.4f}" for tilt in tilts)


def tie(mnemonic: str, first: str, second: str, value: float) -> str:
    """Return a card of a distance or a height difference."""
    return f"{mnemonic} {first:<8} {second:<8} {value:12.4f} {0.02:8.4f}"


def conditions(
    temperature: str,
    salinity: str,
    *,
    chlorinity: str = "",
    wavelength: str = "550.00",
    formula: str = "",
    air: tuple[str, str] = ("", ""),
) -> str:
    """Return a WTC card."""
    return f"WTC {temperature:>7} {salinity:>7} {chlorinity:>7} {wavelength:>8} {formula:7} {air[0]:>7} {air[1]:>8}"


def water_options(level: str = "", tilt: str = "", index: str = "", datum: str = "") -> str:
    """Return an OP2 card."""
    return f"OP2 {'':8} {'':5} {level:5} {tilt:6} {index:6} {datum:7}"


CAM = GOOD[4].replace("RC8 ", "RC9 ")

CASES: list[Case] = [
    case(
        deck(add("BAS 842      841          702.8513   0.2000")),
        "49 BAS [842      841] already given on line 48",
    ),
    # --- lenses ---
    case(
        deck(
            replace(6, "RC8 ", "RC9 "),
            add(CAM, "CAL RC9  F", "CAL RC9  F", "CAL RC7  K1", "LNS RC9     0.01200   0.00000"),
        ),
        "~50 CAL.camera [RC9] camera RC9 took one photo: its lens can hardly be told from its station",
        "50 CAL.camera [RC9] a lens with a principal point of best symmetry of its own (LNS) cannot be estimated",
        "~50 CAL.sigma [] MUSAT-IIA holds cameras: of a lens only values, and standard deviations, count",
        "51 CAL.camera [RC9] a lens with a principal point of best symmetry of its own (LNS) cannot be estimated",
        "51 CAL.parameter [F] this parameter of camera RC9 is already given on line 50",
        "52 CAL.camera [RC7] camera RC7 has no CAM card",
    ),
    # --- inertial unit ---
    case(
        deck(add("INO RPY", ins("841"))), "50 INS [] MUSAT-IIA knows no inertial attitudes: program IIIA (OPT) does"
    ),
    case(
        deck(IIIA, add(ins("841"), ins("842"))),
        "49 INS [] nothing says what its angles are: INO card with OPK, POK or RPY",
    ),
    case(deck(IIIA, add("INO OPK")), "49 INO [] it is that of INS cards, and there are none"),
    case(
        deck(
            IIIA,
            add(
                "INO RPY",
                ins("841", 181.0, 91.0, 361.0),
                ins("999"),
                ins("841"),
                ins("842", sigma=0.0),
                ins("843", sigma=-5.0),
                mis("RC8", sigma="  60.0", free="F"),
                mis("RC8", angle=180.5),
            ),
        ),
        "50 INS.angle_1 [181.00000000] an angle of 181.0000 degrees is beyond 180",
        "50 INS.angle_2 [91.00000000] a pitch of 91.0000 degrees is beyond 90",
        "50 INS.angle_3 [361.00000000] an angle of 361.0000 degrees is beyond 360",
        "51 INS.photo [999] photo 999 has no station card (STA or STX)",
        "52 INS.photo [841] the inertial attitude of photo 841 is already given on line 50",
        "53 INS.sigma_x [0.0] a standard deviation must be greater than zero",
        "54 INS.sigma_x [-5.0] a standard deviation must be greater than zero",
        "55 MIS.free [F] each component has a standard deviation",
        "56 MIS.camera [RC8] the misalignment of camera RC8 is already given on line 55",
        "56 MIS.omega [180.50000000] a misalignment of 180.5000 degrees is beyond 180",
    ),
    case(
        deck(IIIA, replace(6, "RC8 ", "RC9 "), add(CAM, "INO OPK", ins("842"), mis("RC9", free="F"), mis("RC7"))),
        "52 MIS.camera [RC9] no photo of camera RC9 has an INS card, which could determine its misalignment",
        "53 MIS.camera [RC7] camera RC7 has no CAM card",
    ),
    # --- ports ---
    case(
        deck(
            IIIA,
            replace(6, "RC8 ", "RC9 "),
            add(
                CAM,
                port("RC9 ", -35.0, -1.0, 0.9, 2.1, 31.0, -31.0),
                port("RC9 ", 0.035, 0.01, 1.3, 1.5),
                port("RC7 ", 35.0, 10.0, 1.5, 1.33),
                "CAL RC8  PD",
                "CAL RC9  PD   -0.100000000E+01 0.100000000E+00",
                "CAL RC9  PW    0.210000000E+01 0.100000000E-01",
            ),
        ),
        "12 TID.height [0.2000] the camera of photo 841 is under water behind a port, and sees nothing through the",
        "21 PLT.bathymetric [B] through the water surface: no flag B",
        "50 PRT.distance [-35.000] the distance of a port must be greater than zero",
        "50 PRT.thickness [-1.000] the thickness of a port cannot be negative",
        "50 PRT.glass [0.90000] an index is between 1 and 2",
        "50 PRT.water [2.10000] an index is between 1 and 2",
        "50 PRT.tilt_x [31.0000] a port is not tilted by more than 30 degrees",
        "50 PRT.tilt_y [-31.0000] a port is not tilted by more than 30 degrees",
        "51 PRT.camera [RC9] the port of camera RC9 is already given on line 50",
        "~51 PRT.distance [0.035] 0.035 mm is out of the ordinary for the distance of a port: 1 to 1000 is usual",
        "~51 PRT.thickness [0.010] 0.01 mm is out of the ordinary for the thickness of a port: 0.5 to 200 is usual",
        "~51 PRT.glass [1.30000] an index of 1.3 is out of the ordinary for glass: 1.4 to 1.9 is usual",
        "~51 PRT.water [1.50000] an index of 1.5 is out of the ordinary for water: 1.32 to 1.36 is usual",
        "52 PRT.camera [RC7] camera RC7 has no CAM card",
        "53 CAL.parameter [PD] camera RC8 has no port (PRT card) of which PD could be estimated",
        "54 CAL.value [-0.100000000E+01] PD of a port is not negative",
        "55 CAL.value [0.210000000E+01] PW of a port is within 1 and 2",
    ),
    case(
        deck(IIIA, add(CAM, port("RC9 ", 35.0, 10.0, 1.5, 1.0), port("RC8 ", 35.0, 10.0, 1.5, 1.0), "CAL RC9  PD")),
        "52 CAL.parameter [PD] outside the port of camera RC9 is air (index 1): its distance changes no image",
    ),
    case(
        deck(
            drop(12, 13, 14),
            lambda lines: [text.replace("B", " ") if text[:3] == "PLT" else text for text in lines],
            add(port("RC8 ", 35.0, 10.0, 1.5, 1.33)),
        ),
        "46 PRT [] program IIA has no flat ports: program IIIA adjusts cameras behind them",
    ),
    case(
        deck(
            add(
                "DST RC8  RADL  0.300000000E-07  0.000000000E+00  0.000000000E+00",
                "CAL RC8  F     0.153000000E+03  0.100000000E-01",
                "CAL RC8  K1    0.500000000E-07  0.100000000E-08",
                "CAL RC8  XP    0.500000000E-01  0.100000000E-02",  # the card of the camera says nothing: zero
                "CAL RC8  K2    0.500000000E-12  0.100000000E-13",
            ),
            IIIA,
        ),
        "~50 CAL.value [0.153000000E+03] 100 standard deviations off the 152 of CAM or DST, which does not count",
        "~51 CAL.value [0.500000000E-07] 20 standard deviations off the 3e-08 of CAM or DST, which does not count",
    ),
    # --- references ---
    case(
        deck(
            replace(6, "RC8 ", "RC9 "),
            replace(7, "RC8 ", "RC9 "),
            replace(20, "841 ", "848 "),
            replace(21, "841 ", "848 "),
            replace(47, "1108", "1208"),
            replace(48, "842 ", "849 "),
            add(STA.replace("841", "844"), GOOD[8].replace("841", "844"), GOOD[42].replace("1103", "1203")),
            add("FID RC8  1      106.00000  106.00000", "FMS 843      2      106.000000  106.000000"),
            add("EQL LAKE      0.0500 1104     1107     1102", GOOD[14], tie("DIS", "1105", "9999", 600.0)),
        ),
        "6 STA.camera [RC9] camera RC9 has no CAM card (1 more card names it)",
        "20 PLT.photo [848] photo 848 has no station card (STA or STX) (1 more card names it)",
        "47 EQL.point_2 [1208] point 1208 of an equal elevation group is measured on no photo",
        "48 BAS.photo_2 [849] photo 849 has no station card",
        "~49 STA.photo [844] nothing is measured on photo 844",
        "~51 CTG.point [1203] control point 1203 is measured on no photo: it cannot be used",
        "~52 FID [] 1 card carried and listed, not applied",
        "~53 FMS [] 1 card carried and listed, not applied",
        "53 FMS.mark [2] camera RC8 has no calibrated mark 2 (FID)",
        "54 EQL.point_3 [1102] point 1102 is already in an equal elevation group on line 47",
        "55 PLT.point [1101] point 1101 is already measured on photo 841 on line 15",
        "~56 DIS [] the distances take no part: program IIA does not use them, IIIA does",
        "~56 DIS.point_2 [9999] point 9999 is measured on no photo: its distance cannot be used",
    ),
    case(deck(drop(6, 7, 8)), "- - [] the deck has no exposure stations (no STA or STX card)"),
    case(deck(drop(9, 10, 11)), "- - [] the deck has no attitudes (no ATT card)"),
    case(deck(drop(6), add(COMPUTE, CAM)), "14 PLT.photo [841] any of 2 cameras may have taken it"),
    case(deck(drop(10)), "7 STA.photo [842] photo 842 has no attitude card (ATT)"),
    # --- values: many on one deck, of which none hides another ---
    case(
        deck(
            replace(2, "   10.00", "  -10.00"),
            replace(3, "clrk66", "clark6"),
            replace(4, "1.340000", "1.299999"),
            replace(9, "ATT 841        0 17 11.3240", "ATT 841     -395 17 11.3240"),
            replace(10, " 52.5296", " 60.0000"),
            replace(12, "    0.2000         ", "    0.2000   1.E-30"),
            replace(43, "V ", "VX"),
            replace(43, "0.100", "0.000"),  # of a fixed point: not used
            replace(43, " 17.0386", "  1.E300"),
            replace(45, " 20 37.23211", "    37.23211"),
            replace(47, "0.0500", "      "),
            replace(48, " 702.8513 ", "-702.8513 "),
            add("BAS 843      843          702.8513   0.0000", "DST RC8  TABL  0.300000000E+02"),
            add("EQL LAKE      0.0500 1104     1105", "EQL LAKE      0.0600 1106", "EQL POND      0.0500 1107"),
        ),
        "2 OPT.plate_sigma [-10.00] a standard deviation must be greater than zero",
        "3 ELL.name [clark6] 'clark6' is no ellipsoid that PROJ knows",
        "4 WTR.index [1.299999] a refractive index of 1.3 is not within 1.3 to 1.4, as that of water",
        "9 ATT.x_tilt [-395 17 11.3240] an angle of -395.2865 degrees is beyond 360",
        "10 ATT.y_tilt_sec [60.0000] 60 is not at least 0 and less than 60",
        "12 TID.sigma [1.E-30] 1e-30 is next to nothing: 1e-09 m at least, or a blank",
        "43 CTG.height [1.E300] 1e+300 is beyond 1e+08 m",
        "45 CTG.latitude [19    37.23211] the latitude is known by the kind of the point, but blank",
        "45 CTG.latitude_min [] blank, but other parts of the latitude are given",
        "47 EQL.sigma [] group SHORE has no sigma",
        "48 BAS.length [-702.8513] a length must be greater than zero",
        "49 BAS [843      843] an air base needs two different photos",
        "49 BAS.sigma [0.0000] a standard deviation must be greater than zero",
        "~50 DST [] 1 card carried and listed, not applied",
        "50 DST.value_2 [] a calibrated radius needs its distortion",
        "52 EQL.sigma [0.0600] group LAKE has a sigma of 0.05 m on line 51",
        "~53 EQL.group [POND] group POND has fewer than two points",
    ),
    case(
        deck(
            replace(4, "1.340000", "1.319000"),
            replace(5, "  152.00000", "    0.15200"),
            replace(9, "ATT 841        0 17 11.3240", "ATT 841      -95 17 11.3240"),
            replace(15, " -71.9650000", "-171.9650000"),
        ),
        "~4 WTR.index [1.319000] 1.319 is out of the ordinary: that of water is 1.32 to 1.36",
        "~5 CAM.focal_length [0.15200] 0.152 mm is out of the ordinary (3 to 3000 mm)",
        "~9 ATT.x_tilt [-95 17 11.3240] a tilt of -95.2865 degrees, where most photos have less than 30",
        "~15 PLT.y [-171.9650000] y = -171.965 mm lies outside the format of 230 mm of camera RC8",
    ),
    case(
        deck(
            replace(3, "clrk66" + " " * 40, " " * 18 + "-378206.4000" + " " * 8 + "0.500000"),
            replace(4, "1.340000", "2.010000"),
            replace(4, f"{'':20}00000004", f"DIAMOND{'':13}00000004"),
            replace(17, "  2.6290000  70.7780000", "  0.0000000   0.0000000"),
            replace(42, "    5.0386", " " * 10),
            replace(44, "19 20 59.99956 -81 18 12.01638", " 0  0  0.00000   0  0  0.00000"),
            replace(45, "0.1000.100", "     0.100"),
        ),
        "3 ELL.semi_major_axis [-378206.4000] an axis must be greater than zero",
        "3 ELL.inverse_flattening [0.500000] must be 0, or greater than 1",
        "4 WTR.index [2.010000] a refractive index of 2.01 is not within 1 to 2",
        "17 PLT [0.0000000   0.0000000] 0 of point 1103, which by other photos lies 71 mm from there",
        "42 CTG.height [] the height is known by the kind of the point, but blank",
        "44 CTG [0  0  0.00000   0  0  0.00000   14.0384] zeros for the position of the control point, far from",
        "45 CTG.sigma_east [] the east component is known and not fixed: it needs a sigma",
    ),
    case(
        deck(
            replace(4, "1.340000", f"{'':8}"),
            replace(4, f"{'':20}00000004", f"BENZENE{'':13}00000004"),
            add(conditions("20.00", "35.00")),
        ),
        "4 WTR.liquid [BENZENE] the index is computed for water on WTC: no liquid has a name here",
    ),
    case(
        deck(replace(3, "clrk66" + " " * 24, "clrk66" + " " * 12 + "6378206.4000")),
        "3 ELL.name [clrk66] an ellipsoid has a name or an axis, not both",
        "3 ELL.inverse_flattening [] blank, where an axis is given",
    ),
    case(deck(replace(3, "clrk66", " " * 6)), "3 ELL.name [] an ellipsoid needs a name, or an axis"),
    case(deck(plates_a_thousandth), "~15 PLT [-0.0045140  -0.0719650] are they in millimetres?"),
    case(
        deck(replace(5, "230.00   230.00", "               "), replace(15, " -71.9650000", "-971.9650000")),
        "15 PLT.y [-971.9650000] mm lies 5 focal lengths off the axis of camera RC8, which has no",
    ),
    case(
        deck(
            replace(16, " -0.9490000  -0.7130000", "  0.0000000   0.0000000"),
            replace(17, "  2.6290000  70.7780000", "  0.0000000   0.0000000"),
        ),
        "16 PLT [0.0000000   0.0000000] 0 of point 1102, and of another one on the photo",
        "17 PLT [0.0000000   0.0000000] 0 of point 1103, and of another one on the photo",
    ),
    case(
        deck(add(*(f"FID RC8  {mark:4}   0.0000000   0.0000000" for mark in "AB"))),
        "~49 FID [] plate coordinates are taken as refined",
        "49 FID [0.0000000   0.0000000] x = y = 0, and so has another one",
        "50 FID [0.0000000   0.0000000] x = y = 0, and so has another one",
    ),
    case(deck(replace(43, "  909576.9971", " " * 13), lines=GEOCENTRIC), "43 CTX.x [] hold a point only together"),
    # --- systems ---
    case(
        deck(replace(2, "GEOG", "LOCL"), drop(3)),
        "5 STA [19 21  0.00000 -81 18 36.00000 1500.0000] a geographic position, like 2 more, in a job",
        "41 CTG [19 20 37.23384 -81 18 36.00000    5.0386] in a job of system LOCL",
    ),
    case(
        deck(add(STX, GOOD[8].replace("841", "844"))),
        "~49 STX.photo [844] nothing is measured on photo 844",
        "49 STX [1000.0000      100.0000    1500.0000] a rectangular position, in a job of system GEOG",
    ),
    case(deck(drop(3)), "- - [] a job of system GEOG needs an ellipsoid (ELL card)"),
    case(deck(add("ELL clrk66"), lines=LOCAL), "~48 ELL [] a local job has no ellipsoid: left out"),
    case(
        deck(replace(6, "-5952441.8201", " -952441.8201"), lines=GEOCENTRIC),
        "6 STX [909788.3986  -952441.8201 2100314.2898] 2479.1 km from the geocentre is not near the ellipsoid",
    ),
    case(
        deck(replace(2, "GEOC", "LOCL"), drop(3), lines=GEOCENTRIC),
        "5 STX [909788.3986 -5952441.8201 2100314.2898] a position that looks geocentric, like 2 more, in a job",
        "41 CTX [909610.3238 -5951276.7361 2099158.4810] a position that looks geocentric, like 4 more, in a job",
    ),
    # --- water ---
    case(
        deck(replace(33, " B ", "   "), replace(44, "F  ", "F B")),
        "33 PLT.bathymetric [] point 1047 is not flagged bathymetric here, and is on its first card",
        "44 CTG.bathymetric [B] point 1105 is flagged bathymetric here, and is not on its first card",
        "~44 CTG.height [14.0384] 14.0384 m: 13.74 m (137.4 sigmas) above the water of all its photos, and",
    ),
    case(deck(replace(43, "   17.0386", "   -0.2010")), "~43 CTG.height [-0.2010] 0.40 m (4.0 sigmas) below"),
    case(
        deck(replace(33, " B ", " D "), replace(44, "F  ", "F D")),
        "33 PLT.bathymetric [D] point 1047 is flagged dry here, and bathymetric on its first card",
        "44 CTG.bathymetric [D] point 1105 is flagged dry here, and is not on its first card",
    ),
    case(deck(drop(4)), "20 PLT.bathymetric [B] 2 bathymetric points, but no WTR card with the refractive index"),
    case(deck(add(conditions("12.50", "35.00"))), "4 WTR.index [1.340000] given here, and on WTC what it"),
    case(deck(replace(4, "1.340000", "        ")), "4 WTR.index [] blank, and no WTC card says"),
    case(
        deck(drop(4), add(conditions("30.50", "42.10", wavelength="399.00", air=("-41.00", "99.00")))),
        "48 WTC.temperature [30.50] 30.5 degrees Celsius: the formula quan-fry holds for 0 to 30",
        "48 WTC.salinity [42.10] 42.1 parts per thousand: the formula quan-fry holds for 0 to 42",
        "48 WTC.wavelength [399.00] 399 nm: the formula quan-fry holds for 400 to 700",
        "48 WTC.air_temperature [-41.00] the formula of air holds for -40 to 100",
        "48 WTC.air_pressure [99.00] 99 hPa: the formula of air holds for 100 to 1400",
    ),
    *(
        case(deck(drop(4), add(conditions("20.00", salinity, chlorinity=chlorinity))), f"48 WTC.{problem}")
        for salinity, chlorinity, problem in (
            ("", "23.381", "chlorinity [23.381] is a salinity of 42.24: the formula quan-fry holds for 0 to 42"),
            ("35.00", "19.200", "chlorinity [19.200] one or the other, not both"),
            ("", "", "salinity [] blank, and no chlorinity: one of them is needed, 0 for fresh water"),
        )
    ),
    case(
        deck(drop(4), add(conditions("20.00", "35.00", wavelength="250.00", formula="IAPWS"))),
        "48 WTC.salinity [35.00] the formula iapws holds for 0 only",
        # of pure water from 200 nm on, but the index of the air begins at 300
        "48 WTC.wavelength [250.00] 250 nm: the formula iapws holds for 300 to 1100",
    ),
    case(deck(drop(13)), "31 PLT.photo [842] photo 842 has submerged points but no TID card"),
    case(deck(replace(12, "    0.2000", " 1500.0000")), "12 TID.height [1500.0000] is not below its exposure"),
    # --- datum ---
    case(
        deck(drop(*range(36, 42)), add(tie("DIS", "1105", "1108", 600.0))),
        "8 STA.photo [843] photo 843 has 2 usable rays (2 measured) and none of its six",
        "~30 PLT.point [1108] point 1108 has a single ray and no known component",
        "~43 DIS [] the distances take no part: program IIA does not use them, IIIA does",
        "~43 DIS.point_2 [1108] point 1108 has a single ray: its distance cannot be used",
    ),
    case(deck(drop(42, 44)), "- - [] the block has 1 horizontally and 2 vertically known points"),
    case(
        deck(replace(43, "V ", "C "), replace(46, "V ", "C "), drop(47)),
        "~- - [] 3 horizontally and 2 vertically known points or stations",
    ),
    case(
        (FOLDER / "two_parts.crd").read_bytes(),
        "- - [] the part of the block with photos 851, 852 has no horizontally and no vertically",
        *(warning(line, "PLT.point", str(line + 2138), "has a single ray") for line in (69, 70, 71)),
    ),
    # --- programs ---
    case(
        deck(add(water_options("ONE", "ADJUST", "ADJUST", "FREE"), tie("DIS", "1105", "1106", 600.0))),
        "49 OP2.water_level [ONE] 'ONE' needs program IIIA",
        "49 OP2.water_tilt [ADJUST] 'ADJUST' needs program IIIA",
        "49 OP2.water_index [ADJUST] 'ADJUST' needs program IIIA",
        "49 OP2.datum [FREE] 'FREE' needs program IIIA",
        "~50 DIS [] the distances take no part: program IIA does not use them, IIIA does",
    ),
    case(deck(replace(2, "OPT IIA ", "OPT IIIA")), "~2 OPT.refraction [WATPT] 'WATPT' is not for program IIIA"),
    case(
        deck(IIIA, add(water_options("DAY"))),
        "~12 TID.sigma [] no sigma: the measurements alone have to determine this unknown",
        *(Expected(line, "TID.day", "", "blank, and the unknown corrections") for line in (12, 13, 14)),
    ),
    case(
        deck(IIIA, drop(4), add(water_options(index="ADJUST"), conditions("12.50", "35.00"))),
        "~49 WTC [] no sigma: the measurements alone have to determine this unknown",
    ),
    # --- covariances of control ---
    case(
        deck(LOOSE, add(covariances("1101"), covariances("1101"), covariances("NOWHERE"))),
        "50 CTC.point [1101] the covariances of control point 1101 are already given on line 49",
        "51 CTC.point [NOWHERE] control point NOWHERE has no CTG or CTX card",
    ),
    case(
        deck(LOOSE, add(covariances("1101", first="1.200000"), covariances("1103"), covariances("1105"))),
        "49 CTC.east_north [1.200000] a correlation of 1.2 is not between -1 and 1",
        "50 CTC.point [1103] control point 1103 has the kind V on line 43, and needs its sigma there; expected F",
        "51 CTC [0.015000  0.012000  0.031000] the sigmas are 0.015 0.012 0.031 m here and 0.1 0.1 0.1 m on line",
    ),
    case(
        deck(LOOSE, add("CTC 1101      0.015000  0.012000  0.031000  0.900000 -0.900000  0.900000")),
        "49 CTC [0.900000 -0.900000  0.900000] no positive definite matrix: its smallest eigenvalue is -0.8",
    ),
    case(
        deck(LOOSE, replace(42, "1101    F ", "1101    FX"), add(covariances("1101"))),
        "49 CTC.point [1101] control point 1101 is fixed on line 42: covariances have no effect on it",
    ),
    case(
        deck(LOOSE, add("ORI SINGLE-RAY       FULL  ADJUST        841", covariances("1101"))),
        "~50 CTC [0.200000 -0.150000  0.300000] an orientation goes by the standard deviations alone",
    ),
    # terrestrial survey
    case(
        deck(add("DIR 1101     1105       41 12 07.3   0.0005", "HOR 1101     1105       41 12 07.3")),
        "49 - [DIR] 'DIR' is no card; angles, directions and coordinates of terrestrial survey are not",
        "50 - [HOR] 'HOR' is no card; angles, directions and coordinates of terrestrial survey are not",
    ),
    # --- headings ---
    # all headings counted from north
    case(
        deck(
            replace(9, "  2 51 53.2403", " 92 51 53.2403"),
            replace(10, "  1 43  7.9442", " 91 43  7.9442"),
            replace(11, " -3 26 15.8884", " 86 33 44.1116"),
        ),
        "~9 ATT.heading [92 51 53.2403] 93 degrees, where the images point to about 5",
        "~10 ATT.heading [91 43  7.9442] 92 degrees, where the images point to about 2",
        "~11 ATT.heading [86 33 44.1116] 87 degrees, where the images point to about -",
    ),
    case(
        deck(replace(8, "  2 51 53.2403", "-90  0  0.0000"), lines=LOCAL),
        "~8 ATT.heading [-90  0  0.0000] -90 degrees, where the images point to about 5",
    ),
    # --- orientation ---
    case(
        deck(add("ORI SINGLE-RAY       FULL  ADJUST        841      NOWHERE")),
        "49 ORI.method [SINGLE-RAY] takes 1 different photos, not 2 (841, NOWHERE), named here",
        "49 ORI.second [NOWHERE] photo NOWHERE has no images",
    ),
    # --- places ---
    case(
        deck(replace(44, "-81", " 81")),
        "~44 CTG [19 20 59.99956  81 18 12.01638   14.0384] point 1105 lies 11,884 km from the stations, but 0 km "
        "with the other sign of the longitude",
    ),
    case(
        (FOLDER.parent / "verdict/images_y_down.crd").read_bytes(),
        "~17 PLT [-2.7979800 -79.4101070] the images are mirror images of the control",
    ),
    # --- scales ---
    case(
        (FOLDER.parent / "verdict/control_in_feet.crd").read_bytes(),
        "~104 CTX [-2321.6387      134.2685      63.8375] as if control were in feet and stations in metres",
    ),
    case(
        (FOLDER.parent / "st_thomas/st_thomas.crd").read_bytes().replace(b"152.25000", b"305.00000"),
        "~5 CAM.focal_length [305.00000] 2.01 times as wide as on the photos, as if the focal length were 152.5 mm",
    ),
]
