"""Centre-of-mass offset: from Level-1 files to a reported offset."""

from __future__ import annotations

from flows.engine import flow
from gravcal.data import catalog
from tasks import com_offset, common

TORQUERS = ("inertia", "dipole_per_current")
TORQUERS_WITH_SIGMA = (*TORQUERS, "inertia_sigma", "dipole_per_current_sigma")
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")


@flow(name="com_offset")
def calibrate(source, chosen):
    """Offset of the centre of mass from the manoeuvres of one day."""
    satellite = catalog.satellite(source.satellite).settings()
    given = lambda *names: common.settings_of(satellite, *names)  # noqa: E731
    read = {name: common.ingest(source.file(*names), event=source.event) for name, names in PRODUCTS.items()}
    found = com_offset.detect(read["mag"], **chosen.for_stage("detect"))
    aligned = com_offset.align(found, *(read[n] for n in ALIGNED), **chosen.for_stage("align"))
    checked = com_offset.field(aligned, **chosen.for_stage("field"))
    smoothed = com_offset.attitude(aligned, checked, **chosen.for_stage("attitude"), **given(*TORQUERS))
    quiet = com_offset.noise(aligned, **chosen.for_stage("noise"))
    angular = {
        v: com_offset.angular_acceleration(
            smoothed, aligned, variant=v, **chosen.for_stage("angular_acceleration"), **given(*TORQUERS_WITH_SIGMA)
        )
        for v in VARIANTS
    }
    solved = [
        com_offset.solve(aligned, smoothed, angular[v], quiet, variant=v, **chosen.for_stage("solve")) for v in VARIANTS
    ]
    return com_offset.combine(*solved, **chosen.for_stage("combine"))


#: Level-1 products read, most wanted first.
PRODUCTS = {
    "acc": ("ACC1A",),
    "sca": ("SCA1B",),
    "mag": ("MAG1B",),
    "orbit": ("GNI1B", "GNV1B"),
    "tim": ("TIM1B",),
    "clk": ("CLK1B",),
}
ALIGNED = ("acc", "sca", "mag", "orbit", "tim", "clk")
