"""Ranging of a pair against its orbits with the antenna correction left out."""

from __future__ import annotations

from flows import kbr_phase_centre
from gravcal import catalog
from gravcal.calibrations.ranging_check import view
from tasks import common

SAID = "phase centres are calibrated by wiggles; routine pointing moves them by less than the orbit errors"
NOTES = [
    "Each block has its own bias and slow orbit error; the noise of one half of the day is measured in the other.",
    "Phase centres are null where their error is larger than a wiggle would leave: routine pointing turns the line of "
    "sight by less than a milliradian and moves x by the square of that, far below the orbit errors.",
    "What was tried says for every candidate the size that the day gives it and the error of that size.",
]


def prepare(data, satellite, date, chosen) -> dict:
    """Blocks and candidates of one day.

    Parameters
    ----------
    data : folder
    satellite : any letter of the pair
    date : YYYY-MM-DD
    chosen : Parameters
    """
    from gravcal.io.readers import read
    from tasks import kbr_phase_centre as stages

    source = kbr_phase_centre.CALIBRATION.source(data=data, satellite=satellite or "X", date=date)
    pair, settings = source.satellite, catalog.parameters("kbr_phase_centre")
    wanted = [("KBR1B", {"AB": "X", "CD": "Y"}[pair])] + [("GNV1B", x) for x in pair] + [("SCA1B", x) for x in pair]
    files = [source.file(product, satellite=letter) for product, letter in wanted]
    nominal = tuple(tuple(float(v) for v in catalog.satellite(x).com_to_antenna.value) for x in pair)
    aligned = stages.align(*(read(f) for f in files), **settings.for_stage("align"))
    pointed = stages.pointing(aligned, **settings.for_stage("pointing"), nominal_m=nominal, given=())
    options = settings.for_stage("observable") | {"variant": "range", "nominal_m": nominal}
    equations = stages.observable(aligned, pointed, **options)
    blocks, candidates, facts = view.view(equations, aligned, nominal, **chosen.for_stage("ranging"))
    limit = {"ranging.phase_centre": 1e-3 * settings.determined_limit_mm}
    words = {
        "largest_sigma": limit,
        "calibration": "kbr_phase_centre",
        "event": source.event,
        "said": SAID,
        "notes": NOTES,
    }
    runs = [(pair, blocks, candidates)]
    return words | common.named(source.event, files) | {"runs": runs, "facts": {pair: facts}}
