"""Phase centres from ranging, orbits and attitudes of a day without wiggles; source: `Source`, chosen: `Parameters`."""

from flows import kbr_phase_centre as wiggles
from flows.calibration import Calibration, Discovery, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import kbr_phase_centre, ranging


@flow(name="ranging")
def calibrate(source, chosen):
    """ProductRef of the report: phase centres of both satellites by the slow motion of their pointing."""
    return ranging.report(*made(source, chosen).values(), event=source.event, settings=chosen.for_report())


def made(source, chosen):
    """{"estimate", "align", "checks"}: ProductRefs from rows less the effects of the model."""
    rows, checked = quiet_rows(source, chosen)
    rows, _ = DISCOVERY.taken_out(source, chosen, rows, alone=True)
    solved = ranging.estimate(rows, **chosen.for_stage("estimate"))
    return {"estimate": solved, "align": rows, "checks": ranging.checks(checked, solved, **chosen.for_stage("checks"))}


def quiet_rows(source, chosen):
    """ProductRefs of the quiet rows and of the input checks; ranging minus orbit by kbr_phase_centre, its settings."""
    own = wiggles.nominal_of(source) | chosen.for_stage("align")
    chosen = catalog.parameters("kbr_phase_centre")
    files = wiggles.ingested(source, chosen)
    aligned = kbr_phase_centre.align(*files, **chosen.for_stage("align"))
    pointed, equations = wiggles.with_equations(source, chosen, aligned, ("range", "range_rate"))
    checked = wiggles.inputs_checked(source, chosen, files, aligned, pointed, equations)
    return ranging.align(aligned, pointed, equations[0], **own), checked


DISCOVERY = Discovery(
    lambda source, chosen: wiggles.nominal_of(source) | chosen.for_stage("observe"),
    "gravcal.calibrations.ranging.observations",
    records=lambda source, chosen: quiet_rows(source, chosen)[0],
    estimated=lambda _chosen: ("ranging.phase_centre", "ranging.antenna_correction"),
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    simulation=wiggles.CALIBRATION.simulation,
    level_one_files=wiggles.level_one_files,
    products=ranging.KINDS,
    result=results.parameters,
    discovery=DISCOVERY,
)
