"""Flow of tilt_scale, and the record that says what the calibration is."""

from pathlib import Path

from flows.calibration import Calibration, Discovery
from flows.engine import flow
from gravcal.store.results import Value
from gravcal_tilt import stages
from tasks.stage import lazy

files = lazy("gravcal_tilt.files")
science = lazy("gravcal_tilt.science")
HERE = Path(__file__).parent


@flow(name="tilt_scale")
def calibrate(source, chosen):
    """Scale and bias from one day."""
    fitted = stages.fit(records(source, chosen), **chosen.for_stage("fit"))
    return stages.report(fitted, event=source.event, settings=chosen.for_report())


def records(source, _chosen):
    """Angle and reading of the day."""
    (file,) = level_one_files(source)
    return stages.ingest(file, event=source.event, variant="")


def level_one_files(source):
    """The file of a day."""
    return [file for file in files.inventory(source.folder) if file.date == source.date]


def simulation(out, chosen, day, seed, _effects, _truth):
    """Truth of an invented day; its file is written."""
    known = (chosen.scale, chosen.bias_rad, chosen.curvature_per_rad, chosen.noise_rad)
    columns = science.simulate(day, chosen.duration_s, *known, seed)
    files.write(out, chosen.date, columns)
    return {"satellite": "P", "scale": chosen.scale, "bias": chosen.bias_rad}


def values(document):
    """Scale and bias."""
    for name, one in document.get("parameters", {}).items():
        yield Value("", name, one["unit"], one["value"], one["sigma"], None)


CALIBRATION = Calibration(
    name="tilt_scale",
    title="Tilt meter",
    quantity="Scale and bias of the tilt meter",
    begins=("TLT",),
    satellites=("P",),
    inputs={"tilt": ("TLT",)},
    flow=calibrate,
    products=stages.KINDS,
    result=values,
    simulation=simulation,
    files=files,
    mission="toy",
    level_one_files=level_one_files,
    discovery=Discovery(
        lambda _source, chosen: chosen.for_stage("observe"),
        "gravcal_tilt.observations",
        records=records,
    ),
    schema=HERE / "tilt_scale.schema.json",
    catalogue=HERE / "catalog",
)
