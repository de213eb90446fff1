"""What the shell offers when a word is completed: calibrations, events, products, settings, effects."""

import contextlib

from flows.calibration import known


def calibrations(incomplete: str) -> list[str]:
    """Calibrations that begin so."""
    return _beginning(known(), incomplete)


def events(incomplete: str) -> list[str]:
    """Events of the catalogue and of the store."""
    from gravcal import catalog
    from gravcal.store import location

    names = {path.name for path in (location.folder() / "latest").glob("*")}
    with contextlib.suppress(Exception):  # a broken catalogue must not break the shell
        names |= {event.name for event in catalog.events()}
    return _beginning(sorted(names), incomplete)


def products(incomplete: str) -> list[str]:
    """Products that the readable links name: EVENT/STAGE."""
    from gravcal.store import location

    latest = location.folder() / "latest"
    links = sorted(link for link in latest.rglob("*") if link.is_symlink())
    return _beginning([str(link.relative_to(latest)) for link in links], incomplete)


def settings(ctx, incomplete: str) -> list[str]:
    """Parameters of the calibration that was named, with an equals sign."""
    from gravcal import catalog

    name = _calibration(ctx)
    simulated = ctx.info_name == "simulate"
    with contextlib.suppress(Exception):
        known = catalog.parameters(f"simulate_{name}" if simulated else name)
        return _beginning([f"{one}=" for one in known.entries], incomplete)
    return []


def configurations(ctx, incomplete: str) -> list[str]:
    """Recorded experiments of the calibration that was named; what else the commands on configurations take."""
    from gravcal import catalog
    from gravcal.store import configurations as known

    with contextlib.suppress(Exception):
        name = _calibration(ctx)
        more = {"compare": [known.OPERATIONAL, known.CATALOGUE], "promote": [known.CATALOGUE]}.get(ctx.info_name, [])
        more += list(catalog.parameters(name).entries) if ctx.info_name == "settings" else []
        return _beginning([*known.names(name), *more], incomplete)
    return []


def effects(incomplete: str) -> list[str]:
    """Parameters of the effects, with an equals sign."""
    from gravcal.effects import catalogue

    return _beginning(
        [f"{slug}.{p.name}=" for slug, e in sorted(catalogue().items()) for p in e.parameters], incomplete
    )


def engines(incomplete: str) -> list[str]:
    """Engines of a run."""
    from flows.engine import ENGINES

    return _beginning(ENGINES, incomplete)


def _calibration(ctx):
    """Calibration that was named before; an option without its value ends the parsing, and its words are left over."""
    return next((word for word in [ctx.params.get("calibration"), *ctx.args] if word in known()), "")


def _beginning(names, incomplete):
    """Those that begin with what was typed."""
    return [name for name in names if name.startswith(incomplete)]
