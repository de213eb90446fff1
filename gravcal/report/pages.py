"""Pages of the reports: templates of the package filled in, one self-contained file each."""

import hashlib
from functools import lru_cache
from importlib import resources

TEMPLATES = (
    "report.css",
    "parts.html",
    "page.html",
    "com_offset.html",
    "com_offset_history.html",
    "kbr_phase_centre.html",
    "inertial_sensor.html",
    "gradient_torque.html",
    "discovery.html",
)


def render(template, **content):
    """Page of a template; the same content gives the same text.

    Parameters
    ----------
    template : name of a file of this package
    content : what the template names
    """
    return _environment().get_template(template).render(css=_text("report.css"), **content)


def traced(sections, products):
    """Sections whose tables and figures name their products with the digests, as the provenance lists them.

    Parameters
    ----------
    sections : list of dict with "tables" and "figures", whose "source" names products, divided by commas
    products : mapping of name to digest
    """
    return [
        section | {part: [_traced(one, products) for one in section[part]] for part in ("tables", "figures")}
        for section in sections
    ]


def _traced(one, products):
    """Table or figure with the digests of its products."""
    names = [name for name in one["source"].split(", ") if name]
    return one | {"source": ", ".join(f"{name} {products.get(name, '')}".rstrip() for name in names)}


def digest():
    """Digest of all templates, for a stage whose product must change with them.

    Returns
    -------
    digest : str, hexadecimal
    """
    return hashlib.sha256("\0".join(_text(name) for name in TEMPLATES).encode()).hexdigest()


def _text(name):
    """Text of a file of this package."""
    return (resources.files(__package__) / name).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def _environment():
    """Templates that escape what they are given and refuse what they are not."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FunctionLoader(_text),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
