"""Effects: what nature and instruments add, one object each.

The simulator injects an effect, the estimator fits it, discovery proposes it; `catalogue()` lists them all.
"""

from __future__ import annotations

from gravcal.effects import accelerometer, gradient, inertial_sensor, ranging, sensors, torque
from gravcal.effects.base import CHANNELS, Context, Effect, Parameter

__all__ = ["CHANNELS", "Context", "Effect", "Parameter", "catalogue", "effect"]


def catalogue() -> dict[str, Effect]:
    """Every effect by slug."""
    families = (sensors.TIMING, torque.EFFECTS, accelerometer.EFFECTS, sensors.EFFECTS)
    families += (ranging.EFFECTS, inertial_sensor.EFFECTS, gradient.EFFECTS)
    known = [entry for family in families for entry in family]
    return {entry.slug: entry for entry in known}


def effect(slug: str) -> Effect:
    """One effect; an unknown slug names its nearest neighbours.

    Parameters
    ----------
    slug : "family.name"
    """
    known = catalogue()
    if slug not in known:
        import difflib

        from gravcal.errors import CatalogError

        near = difflib.get_close_matches(slug, known, n=3) or sorted(known)[:5]
        raise CatalogError(f"effect {slug!r} is not in the catalogue. Did you mean {', '.join(near)}?", slug=slug)
    return known[slug]
