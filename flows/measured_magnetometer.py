"""Measured magnetometer against the reference field, for each satellite of a folder."""

from __future__ import annotations

from gravcal import catalog
from gravcal.calibrations.magnetometer import series, view
from gravcal.io import archive
from tasks import common

SAID = "the offset does not use the magnetometer; its torques come from the reference field"
NOTES = [
    "The level of the noise is that of the residual with every candidate in the model; it is known to some 10 %.",
    "Causes in one tied set cannot be told apart on these minutes; the first named is the simplest that fits.",
]


def prepare(data, satellite, date, chosen) -> dict:
    """Blocks and candidates of each satellite.

    Parameters
    ----------
    data : folder
    satellite : letters; None for all that have the three products
    date : YYYY-MM-DD
    chosen : Parameters
    """
    letters = satellite or "".join(sorted({f.satellite for f in archive.inventory(data) if f.product == "MAG1B"}))
    source = common.source_of("com_offset", ("MAG1B",), data=data, satellite=letters[:1] or None, date=date)
    settings = chosen.for_stage("magnetometer")
    files, runs, facts = [], [], {}
    for letter in letters:
        field, found = _field(source, letter, settings["igrf_generation"])
        blocks, candidates, facts[letter] = view.view(field, **settings)
        files += found
        runs.append((letter, blocks, candidates))
    event = f"grace-{letters.lower()}-{source.date}"
    words = {"calibration": "com_offset", "event": event, "said": SAID, "notes": NOTES}
    return words | common.named(event, files) | {"runs": runs, "facts": facts}


def _field(source, letter, generation):
    """Field of one satellite and its files."""
    from gravcal.io.readers import read

    found = [source.file(*products, satellite=letter) for products in (("MAG1B",), ("SCA1B",), ("GNV1B",))]
    per_current = catalog.satellite(letter).dipole_per_current.value
    return series.field(*(read(f) for f in found), per_current, generation), found
