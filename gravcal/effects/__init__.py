"""Effects: contributions of nature and instruments to the measurements, one object each.

The simulator injects an effect, the estimator fits it, discovery proposes it; `catalogue()` lists them all.
"""

import difflib

from gravcal.effects import accelerometer, gradient, inertial_sensor, ranging, sensors, torque
from gravcal.effects.base import CHANNELS, Context, Effect, Parameter
from gravcal.errors import CatalogError

__all__ = ["CHANNELS", "Context", "Effect", "Parameter", "catalogue", "effect"]


def catalogue() -> dict[str, Effect]:
    """{slug: Effect} of all families."""
    families = (sensors.TIMING, torque.EFFECTS, accelerometer.EFFECTS, sensors.EFFECTS)
    families += (ranging.EFFECTS, inertial_sensor.EFFECTS, gradient.EFFECTS)
    return {entry.slug: entry for family in families for entry in family}


def effect(slug: str) -> Effect:
    """Effect by its slug "family.name"; for an unknown one a CatalogError names the nearest slugs."""
    known = catalogue()
    if slug not in known:
        near = difflib.get_close_matches(slug, known, n=3) or sorted(known)[:5]
        raise CatalogError(f"effect {slug!r} is not in the catalogue. Did you mean {', '.join(near)}?", slug=slug)
    return known[slug]
