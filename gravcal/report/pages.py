"""Pages of the reports: templates of the package filled in, one self-contained file each."""

from functools import lru_cache
from importlib import resources

from gravcal.report.figures import image


def render(template, **content):
    """Page of a template; the same content gives the same text.

    Parameters
    ----------
    template : name of a file of this package
    content : what the template names; beside an event that was not measured printed values are marked
    """
    origin = content.get("document", {}).get("origin", "measured")
    if origin != "measured":
        content["sections"] = [_apart(section, origin) for section in content["sections"]]
    return _environment().get_template(template).render(css=_text("report.css"), **content)


def _apart(section, origin):
    """Section whose tables and figures with printed values say that these are of other data."""
    mark = f" What is printed belongs to measured data, this event is {origin}."

    def marked(one):
        words = " ".join([one["caption"], *one.get("heads", ())]).lower()
        return one | {"caption": one["caption"] + mark * ("printed" in words)}

    return section | {part: [marked(one) for one in section[part]] for part in ("tables", "figures")}


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


def figure(draw, *given, source, title, caption):
    """Figure of a section; its image is None where a dataset is missing or there is nothing to draw.

    Parameters
    ----------
    draw : function of `given` that returns a matplotlib Figure or None
    given : Datasets and documents, None where there is none
    source : names of the products that were drawn, divided by commas
    title, caption : texts
    """
    known = all(one is not None for one in given)
    return {"image": image(draw, *given) if known else None, "source": source, "title": title, "caption": caption}


def table(caption, heads, rows, *, source="", words=(0,), wide=False, strong=None):
    """Table of a section.

    Parameters
    ----------
    caption, heads : texts
    rows : lists of texts; None continues the cell above
    source : names of the products it was read from, divided by commas
    words : columns that are set to the left
    wide : whether it needs small type
    strong : index of the row that is emphasised, or None
    """
    named = {"caption": caption, "heads": heads, "rows": rows, "source": source}
    return named | {"words": words, "wide": wide, "strong": strong}


def section(title, tables=(), figures=(), notes=()):
    """Section of a page; figures without an image are left out."""
    drawn = [one for one in figures if one["image"]]
    return {"title": title, "tables": [one for one in tables if one], "figures": drawn, "notes": list(notes)}


def numbered(sections):
    """Sections whose figures are numbered in order."""
    every = [one for section in sections for one in section["figures"]]
    for number, one in enumerate(every, start=1):
        one["number"] = number
    return sections


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
