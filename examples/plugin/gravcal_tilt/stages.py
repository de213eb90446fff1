"""Stages of tilt_scale."""

from gravcal.store import product
from tasks.stage import lazy, stage

files = lazy("gravcal_tilt.files")
science = lazy("gravcal_tilt.science")
page = lazy("gravcal_tilt.page")
TIME = {"dims": "time", "units": "seconds since 2000-01-01 12:00:00", "long_name": "GPS time"}
KINDS = product.registered(
    "tilt_scale",
    ingest={
        "time": {"dims": "time"},
        "angle": {"dims": "time", "units": "rad", "long_name": "angle of the turntable"},
        "reading": {"dims": "time", "units": "rad", "long_name": "reading of the tilt meter"},
    },
    fit={
        "time": {"dims": "time"},
        "value": {"dims": "parameter", "units": "1", "long_name": "scale 1, bias rad"},
        "covariance": {"dims": "parameter other", "units": "1", "long_name": "covariance of the values"},
        "residual": {"dims": "time", "units": "rad", "long_name": "residual"},
    },
    report=product.ANY,
)


@stage(reads=["file"], writes="tilt_scale.ingest", version=1)
def ingest(file):
    """Angle and reading of one day."""
    import xarray as xr

    time, angle, reading = files.read(file)
    return xr.Dataset({"angle": ("time", angle), "reading": ("time", reading)}, {"time": time})


@stage(reads=["tilt_scale.ingest"], writes="tilt_scale.fit", version=1)
def fit(observed, *, skip_s: float):
    """Scale and bias without the first seconds."""
    import xarray as xr

    late = observed.sel(time=slice(observed.time[0] + skip_s, None))
    value, covariance, residual = science.fit(late["angle"].values, late["reading"].values)
    dims = {"value": "parameter", "covariance": ("parameter", "other"), "residual": "time"}
    values = {"value": value, "covariance": covariance, "residual": residual}
    return xr.Dataset({name: (dims[name], values[name]) for name in dims}, {"time": late["time"]})


@stage(reads=["tilt_scale.fit"], writes="tilt_scale.report", version=1)
def report(fitted, *, event, settings):
    """Result document and page."""
    return page.report(fitted, event, settings)
