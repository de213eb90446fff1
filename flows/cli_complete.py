"""What the shell offers when a word is completed: calibrations, events, products, settings, effects."""

import contextlib


def calibrations(incomplete: str) -> list[str]:
    """Calibrations that begin so."""
    from gravcal.data.catalog_events import CALIBRATIONS

    return _beginning(CALIBRATIONS, incomplete)


def events(incomplete: str) -> list[str]:
    """Events of the catalogue and of the store."""
    from gravcal.data import catalog, location

    names = {path.name for path in (location.folder() / "latest").glob("*")}
    with contextlib.suppress(Exception):  # a broken catalogue must not break the shell
        names |= {event.name for event in catalog.events()}
    return _beginning(sorted(names), incomplete)


def products(incomplete: str) -> list[str]:
    """Products that the readable links name: EVENT/STAGE."""
    from gravcal.data import location

    links = sorted((location.folder() / "latest").glob("*/*"))
    return _beginning([f"{link.parent.name}/{link.name}" for link in links], incomplete)


def settings(ctx, incomplete: str) -> list[str]:
    """Parameters of the calibration that was named, with an equals sign."""
    from gravcal.data import catalog

    name = ctx.params.get("calibration") or ""
    simulated = ctx.info_name == "simulate"
    with contextlib.suppress(Exception):
        known = catalog.parameters(f"simulate_{name}" if simulated else name)
        return _beginning([f"{one}=" for one in known.entries], incomplete)
    return []


def _beginning(names, incomplete):
    """Those that begin with what was typed."""
    return [name for name in names if name.startswith(incomplete)]
