"""Products of an event as one tree, for notebooks."""

from __future__ import annotations

from gravcal.errors import ProductError
from gravcal.store import housekeeping, location, store


def tree(event: str, configuration: str | None = None):
    """Products that the last run of an event left, as an xarray.DataTree.

    Parameters
    ----------
    event : name
    configuration : name of an experiment; the operational one by default
    """
    import xarray as xr

    entries = housekeeping.entries(event=event, configuration=configuration or location.OPERATIONAL)
    if not entries:
        raise ProductError(
            f"{event}: found no product in {location.folder()}, expected those of a run. Run its event, or set "
            f"GRAVCAL_PRODUCTS; `gravcal products` lists what is there.",
            event=event,
        )
    found = {}
    for entry in entries:
        dataset = store.load(entry.ref)
        if dataset is not None:
            labels = {"event": event, "stage": entry.ref.stage, "key": entry.ref.key}
            found[entry.ref.stage.replace(".", "/")] = dataset.assign_attrs(labels)
    return xr.DataTree.from_dict(found, name=event)
