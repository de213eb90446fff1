"""Pages of the reports: tables and figures that a calibration declares, written into one self-contained file.

A calibration's page is one module, `gravcal/calibrations/<name>/page.py`, with its words beside it in `page.toml`
(`Words`), as in `docs/adding_a_calibration.md`. A figure names products by their stage ("solve.mtq" with the variant;
"solve.*" gives all variants, {variant: Dataset}). They are its arguments and the source under it. `page` draws, numbers
and traces everything, `report` is the body of the stage `report`: result document, judged, and page.
"""

import itertools
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, wraps
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np

from gravcal.report import documents, plain
from gravcal.report.figures import BARE, COLOURS, HANN, grid, image


@dataclass(frozen=True)
class Table:
    """Table of a section."""

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence]  #: cells of each row; None continues the cell above
    reads: Sequence[str] = ()  #: names of the products that it was read from
    words: Sequence[int] = (0,)  #: columns that are set to the left
    wide: bool = False  #: True for small type
    strong: int | None = None  #: index of the row that is emphasised, or None


@dataclass(frozen=True)
class Figure:
    """Figure of a section."""

    #: function of the products in `reads` (of `arguments` if given) that returns a matplotlib Figure or None
    draw: Callable
    reads: Sequence[str]  #: names of products; a missing one leaves out the figure
    caption: str  #: text; its first sentence is the alternative text of the image
    arguments: Sequence | None = None  #: what `draw` takes in place of the products


def figure(*reads: str, caption: str) -> Callable[[Callable], Figure]:
    """Decorator: function (*Datasets of ``reads``) -> matplotlib Figure or None, as a `Figure`."""
    return lambda draw: Figure(draw, reads, caption)


@dataclass(frozen=True)
class Words:
    """Texts of a page from its TOML file, in tables by name; texts are Jinja templates."""

    #: fields of a `Table` but for its rows; of `strong` -1 is the last row. In place of heads there may be columns,
    #: [head, expression of the entries of a record] each, and `each`, the records as an expression of the document
    tables: Mapping[str, Mapping]
    #: caption; "panels" = [rows, columns] and arguments of `grid` where these do not depend on the data
    figures: Mapping[str, Mapping]
    styles: Mapping[str, Mapping]  #: arguments of what is drawn, colours by their names in `COLOURS`
    notes: Mapping[str, str]  #: everything else
    forms: jinja2.Environment  #: of templates and expressions; filters are functions of `plain` and of the page

    def table(self, name: str, content: Sequence | Mapping, /, **values) -> Table:
        """Table of content: rows; or records, if its TOML has "columns"; or a document, if it has "each".

        Values are fields of the table, or variables of its texts and cells. Cells see the entries of their record, its
        number "k", its "key" in a mapping, and "value" if it is no record.
        """
        fields = self.tables[name] | {key: one for key, one in values.items() if key in Table.__dataclass_fields__}
        if "each" in fields:
            values |= content
            content = self.forms.compile_expression(fields.pop("each"))(values) or ()
        if "columns" in fields:
            fields["heads"], cells = zip(*fields.pop("columns"), strict=True)
            cells = [self.forms.compile_expression(cell, undefined_to_none=False) for cell in cells]
            content = [[cell(values | one) for cell in cells] for one in _records(content)]
        said = [self.forms.from_string(text).render(values) for text in (fields["caption"], *fields["heads"])]
        if fields.get("strong") is not None:
            fields["strong"] %= max(len(content), 1)
        return Table(**fields | {"rows": content, "caption": said[0], "heads": said[1:]})

    def figure(self, *reads: str) -> Callable[[Callable], Figure]:
        """Decorator: a function that draws into panels, one Axes or an array of them, as the `Figure` of its name.

        One whose file names no panels makes its own and returns a matplotlib Figure.
        """

        def declared(draw):  # Figure
            look = dict(self.figures[draw.__name__.lstrip("_")])
            caption = self.forms.from_string(look.pop("caption")).render()
            if "panels" not in look:
                return Figure(draw, reads, caption)
            rows, columns = look.pop("panels")

            @wraps(draw)
            def drawn(*inputs):  # matplotlib Figure, None if all panels are empty
                made, panels = grid(rows, columns, **look)
                draw(np.squeeze(panels)[()], *inputs)
                return made if any(panel.has_data() for panel in made.axes) else None

            return Figure(drawn, reads, caption)

        return declared

    def note(self, name: str, /, **values) -> str:
        """Text of this name, rendered with these values."""
        return self.forms.from_string(self.notes[name]).render(values)

    def said(self, name: str, /, **values) -> list[str]:
        """Texts in the list of this name, rendered with these values, without empty ones."""
        return [text for text in (self.forms.from_string(text).render(values) for text in self.notes[name]) if text]


def _records(content):
    """Records of a mapping or sequence, see `Words.table`."""
    named = [{"key": key} for key in content] if isinstance(content, Mapping) else [{}] * len(content)
    values = content.values() if isinstance(content, Mapping) else content
    entries = [dict(one) if isinstance(one, Mapping) else getattr(one, "__dict__", {"value": one}) for one in values]
    return [{"k": k} | name | entry for k, (name, entry) in enumerate(zip(named, entries, strict=True))]


def words(module: str, name: str, **forms: Callable) -> Words:
    """Words of a page from the TOML file ``name`` next to a module file; forms are Jinja filters added to `plain`."""
    content = tomllib.loads(Path(module).with_name(name).read_text(encoding="utf-8"))
    content["styles"] = _coloured(content.get("styles", {}))
    known = jinja2.Environment(undefined=jinja2.StrictUndefined)
    known.filters |= vars(plain) | forms
    known.globals |= {"hann": HANN, "bare": BARE, "notes": content.get("notes", {})}
    return Words(*(content.get(part, {}) for part in ("tables", "figures", "styles", "notes")), known)


def _coloured(style):
    """Style, or styles in a table, with colours in place of their names."""
    plain_ones = {name: COLOURS.get(one, one) for name, one in style.items() if not isinstance(one, dict)}
    return plain_ones | {name: _coloured(one) for name, one in style.items() if isinstance(one, dict)}


@dataclass(frozen=True)
class Section:
    """Section of a page: notes, tables, then figures; a table without rows is left out."""

    title: str
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    notes: Sequence[str] = ()
    beside: bool = False  #: True to set the tables side by side


def report(calibration, body, products, checks, sections, *, event, settings, **about) -> tuple[dict, dict[str, str]]:
    """(result document, judged; {"result.json", "report.html": text}); see `documents.delivered`.

    Sections: function (judged document) -> [Section]; about: other keywords of `page`.
    """
    document = documents.delivered(calibration, body, products, checks, event=event, settings=settings)
    html = page(document, sections(document), products, **about)
    return document, {"result.json": documents.text(document), "report.html": html}


def page(
    document: Mapping,
    sections: Sequence[Section],
    products: Mapping,
    *,
    heading: str,
    subtitle: str = "",
    good: bool | None = None,
    badges: Sequence[tuple] = (),
    lines: tuple[str, str] | None = None,
) -> str:
    """Page (HTML) of an event from its judged document; the same content gives the same text.

    Products are {stage or "stage.variant": Dataset or None}, badges (title, good, text) each, lines title and
    text of a delivered file such as vector lines. The heading names the calibration, the subtitle the data; good:
    verdict met, missed, or None where that is not asked.
    """
    numbers = itertools.count(1)
    shown = [_shown(section, document, products, numbers) for section in sections]
    return render(
        "page.html",
        document=document,
        heading=heading,
        verdict=true_units(document["verdict"]["text"]),
        mood=MOODS[good],
        subtitle=subtitle,
        badges=[{"title": t, "text": text, "sign": SIGNS[good], "mood": MOODS[good]} for t, good, text in badges],
        sections=shown,
        settings=flat(documents.settings_of(document)),
        provenance=flat({name: one for name, one in document["provenance"].items() if name != "settings"}),
        lines=lines,
    )


def _shown(section, document, products, numbers):
    """Section as a dict for the template; figures are drawn, and numbered by ``numbers`` (iterator) if not empty."""
    figures = []
    for one in section.figures:
        inputs = arguments(one, products)
        drawn = None if any(item is None for item in inputs) else image(one.draw, *inputs)
        if drawn is not None:
            own = {"image": drawn, "number": next(numbers), "title": one.caption.split(".")[0], "caption": one.caption}
            figures.append(own | {"source": _source(document, one.reads)})
    tables = [vars(one) | {"source": _source(document, one.reads)} for one in section.tables if one.rows]
    return vars(section) | {"tables": tables, "figures": figures, "notes": [true_units(note) for note in section.notes]}


SIGNS = {True: "✓", False: "✗", None: "?"}
MOODS = {True: "good", False: "bad", None: ""}


def arguments(one: Figure, products: Mapping) -> list:
    """Arguments of ``one.draw``: ``one.arguments``, or the Datasets that it reads, None for a missing one."""
    inputs = [] if one.arguments is None else list(one.arguments)
    for name in one.reads if one.arguments is None else ():
        prefix, known = name.removesuffix("*"), {key: data for key, data in products.items() if data is not None}
        variants = {key.removeprefix(prefix): data for key, data in known.items() if key.startswith(prefix)}
        inputs.append(known.get(name) if prefix == name else variants)
    return inputs


def _source(document, reads):
    """Text "product digest, ..." of the products read, digests from the provenance."""
    digests, names = document["provenance"].get("products", {}), []
    for name in (f"{document['calibration']}.{name}" for name in reads):
        prefix = name.removesuffix("*")
        names += [name] if prefix == name else [key for key in digests if key.startswith(prefix)]
    return ", ".join(f"{name} {digests.get(name, '')[:12]}".rstrip() for name in names)


def true_units(text: str) -> str:
    """Terminal text with typographic signs: ±, µ, −, superscripts."""
    signs = {"+-": "±", " um": " µm", " urad": " µrad", " -": " −", "m/s2": "m/s²", "m s-2": "m s⁻²"}
    for typed, sign in signs.items():
        text = text.replace(typed, sign)
    return text


def flat(values: Mapping, before: str = "") -> list[tuple[str, str]]:
    """[(name, text)] of nested settings or provenance, sorted; texts of 60 characters or more shortened."""
    rows = []
    for name, value in sorted(values.items()):
        if isinstance(value, dict):
            rows += flat(value, "" if name in ("products", "inputs") else f"{name}: ")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f"{before}{name}", text if len(text) < 60 else f"{text[:16]}…"))
    return rows


def render(template: str, **content) -> str:
    """HTML of a template of this package; captions note if printed values stand next to data not measured."""
    origin = content.get("document", {}).get("origin", "measured")
    if origin != "measured":
        content["sections"] = [_marked(section, origin) for section in content["sections"]]
    css = (resources.files(__package__) / "report.css").read_text(encoding="utf-8")
    return environment(__package__, ".").get_template(template).render(css=css, **content)


def _marked(section, origin):
    """Section (dict); captions of tables and figures with "printed" say that printed values are of measured data."""
    mark = f" What is printed belongs to measured data, this event is {origin}."

    def marked(one):  # table or figure (dict)
        words = " ".join([one["caption"], *one.get("heads", ())]).lower()
        return one | {"caption": one["caption"] + mark * ("printed" in words)}

    return section | {part: [marked(one) for one in section[part]] for part in ("tables", "figures")}


@lru_cache(maxsize=2)
def environment(package: str, folder: str) -> jinja2.Environment:
    """Jinja environment of the templates in a folder of a package: escapes values, raises for undefined names."""
    how = {"autoescape": True, "undefined": jinja2.StrictUndefined, "trim_blocks": True, "lstrip_blocks": True}
    return jinja2.Environment(loader=jinja2.PackageLoader(package, folder), **how)
