"""Calibrated fields of platform magnetometers as others publish them, in CDF files; needs the extra `cdf`.

GRACE-FO, of GFZ: README of the folder, the product's page of the Swarm DISC catalogue (variables, units, types), and a
public reader that had 64 of the files. GRACE, of DTU: the variables that VirES lists. No such file was at hand here.
"""

from pathlib import Path

import erfa
import numpy as np

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.physics.constants import TAI_MINUS_GPS

#: Names of the files of a satellite and a day.
NAMES = {
    "A": "GRACE_A_MAG_*{day}*.cdf",
    "B": "GRACE_B_MAG_*{day}*.cdf",
    "C": "GF1_OPER_FGM_ACAL_CORR_{day}T*.cdf",
    "D": "GF2_OPER_FGM_ACAL_CORR_{day}T*.cdf",
}
PLACE = ("Latitude", "Longitude", "Radius")  # deg, deg, m
FIELD = ("B_NEC_raw", "B_NEC")  # nT, the first that a file has: B_NEC of GRACE is a mean over 11 s
FLAG = "B_FLAG"  # of GRACE-FO: 0 but in 1 % of a day at most; its meaning is not documented in any page at hand
EPOCH_S = 63113947200.0  # from the origin of CDF_EPOCH, 0000-01-01, to 2000-01-01 12:00


def files(folder: Path, satellite: str, date: str | None) -> list[archive.LevelOneFile]:
    """[LevelOneFile], product "CDF", of a satellite and a day: the newest release, or [] where there is none."""
    pattern = NAMES[satellite].format(day=str(date).replace("-", ""))
    newest = sorted(Path(folder).rglob(pattern), key=lambda path: path.name)[-1:]
    return [archive.LevelOneFile(one, None, "CDF", satellite, str(date), one.stem[-4:]) for one in newest]


def read(file: archive.LevelOneFile) -> tuple[dict[str, np.ndarray | int], str]:
    """Finite records without a flag as time (n,) s GPS, position_e (n, 3) m, field_n (n, 3) T, and their origin.

    "flagged" is the number of records with a flag, which are left out.
    """
    try:
        import cdflib
    except ModuleNotFoundError:
        remedy = "pip install 'gravcal[cdf]', or take the file out of the folder."
        refuse(file.where, "a CDF file, and no cdflib", "the extra cdf", remedy)
    try:
        content = cdflib.CDF(file.path)
        names = content.cdf_info().zVariables
        field = next((name for name in FIELD if name in names), FIELD[-1])
        missing = sorted({"Timestamp", *PLACE, field} - set(names))
        read_names = [name for name in ("Timestamp", *PLACE, field, FLAG) if name in names and not missing]
        values = {name: np.asarray(content.varget(name)) for name in read_names}
        header = "\n".join(f"{name}: {one[0]}" for name, one in content.globalattsget().items())
    except Exception as reason:  # cdflib raises what it stumbles over
        refuse(file.where, f"what cannot be read ({reason})", "a CDF file", archive.FETCH_AGAIN)
    if missing:
        refuse(file.where, f"no {', '.join(missing)}", "time, place and field", archive.FETCH_AGAIN)
    utc = 1e-3 * values["Timestamp"] - EPOCH_S
    year, month, day = (int(part) for part in file.date.split("-"))
    time = utc + erfa.dat(year, month, day, 0.0) - TAI_MINUS_GPS
    latitude, longitude = (np.radians(values[name]) for name in PLACE[:2])
    equatorial = np.stack([np.cos(longitude), np.sin(longitude)], axis=1) * np.cos(latitude)[:, None]
    position = values["Radius"][:, None] * np.column_stack([equatorial, np.sin(latitude)])
    flagged = values.get(FLAG, np.zeros(time.size)) != 0
    used = ~flagged & np.isfinite(time) & np.isfinite(np.column_stack([position, values[field]])).all(axis=1)
    records = {"time": time, "position_e": position, "field_n": 1e-9 * values[field]}
    records = {name: one[used] for name, one in records.items()} | {"flagged": int(flagged.sum())}
    return records, archive.origin_of_header(header)
