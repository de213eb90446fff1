"""History of the centre of mass over the events of a satellite, with the mass trims."""

import datetime

from gravcal.report.figures import COLOURS, grid, image, legend
from gravcal.report.pages import render
from gravcal.report.plain import AXES, EPOCH
from gravcal.report.words import plus_minus, printed, signed

HEADS = ("date", "event", "variant")


def history(documents, trims=(), published=(), requirement_um=100.0):
    """Table, figure and page of all events; like Table 9 and Figure 12 of 10.3390/rs14164030.

    Parameters
    ----------
    documents : result documents of one satellite; those that deliver nothing are left out
    trims : Trim of the catalogue
    published : Published of the section "history"
    requirement_um : limit that is drawn

    Returns
    -------
    rows : list of dict with "date", "event", "variant", "ours", "printed" or "trim"
    figure : data address of an SVG
    html : str, page with both
    """
    rows = sorted(
        [*_ours(documents), *_printed(published), *(_trim(one) for one in trims)],
        key=lambda row: (row["date"], row["trim"] is not None, row["event"]),
    )
    rows = _joined(rows)
    figure = image(_draw, rows, requirement_um, form="svg")
    html = render(
        "com_offset_history.html", figure=figure, table=table(rows), title=_title(rows), sources=_sources(rows)
    )
    return rows, figure, html


def _ours(documents):
    """Adopted offset of every event that delivered one."""
    for document in documents:
        name = (document.get("adopted") or {}).get("variant")
        if document["status"] != "delivered" or name is None:
            continue
        start = document["manoeuvres"][0]["start"]
        date = (EPOCH + datetime.timedelta(seconds=start)).date()
        yield {"date": date, "event": document["event"], "variant": name, "ours": document["variants"][name]} | _NONE


_NONE = {"printed": None, "trim": None}


def _printed(published):
    """Printed offsets of the history."""
    for one in published:
        date = datetime.date.fromisoformat(one.labels["date"])
        event = one.events[0] if one.events else ""
        yield {"date": date, "event": event, "variant": "", "ours": None, "printed": one, "trim": None}


def _trim(one):
    return {"date": one.date, "event": "", "variant": "", "ours": None, "printed": None, "trim": one}


def _joined(rows):
    """Ours and the printed value of the same event in one row."""
    joined = []
    for row in rows:
        last = joined[-1] if joined else None
        same = last is not None and row["event"] and (last["date"], last["event"]) == (row["date"], row["event"])
        if same and not (last["ours"] and row["ours"]):
            joined[-1] = last | {k: v for k, v in row.items() if v not in (None, "")}
        else:
            joined.append(row)
    return joined


def table(rows):
    """Rows as texts under their heads, for the page.

    Parameters
    ----------
    rows : of `history`
    """
    heads = list(HEADS)
    for axis in AXES:
        heads += [f"{axis} (µm)", "printed"]
    cells = [[str(row["date"]), *_trim_cells(row["trim"])] if row["trim"] else _cells(row) for row in rows]
    caption = "Offset from proof mass to CoM: adopted value ± error (total error), and as printed."
    return {
        "caption": caption,
        "heads": heads,
        "rows": cells,
        "source": "",
        "strong": None,
        "wide": True,
        "words": (0, 1, 2),
    }


def _cells(row):
    """Texts of an event."""
    texts = [str(row["date"]), row["event"], row["variant"]]
    for i in range(3):
        own = row["ours"]
        texts.append(plus_minus(*(own[n][i] for n in ("offset_um", "sigma_um", "sigma_total_um"))) if own else "")
        texts.append(printed(row["printed"], i) if row["printed"] else "")
    return texts


def _trim_cells(trim):
    """Texts of a trim, its size in the column of its axis."""
    seen = "confirmed by the series" if trim.confirmed else "not confirmed by the series"
    texts = [f"mass trim, {seen}", ""]
    for axis in AXES:
        texts += [f"{signed(trim.trim_um, 0)} trim" if trim.axis == axis else "", ""]
    return texts


def _title(rows):
    """Words for the time that is covered."""
    if not rows:
        return "no event"
    return f"{rows[0]['date']} to {rows[-1]['date']}"


def _sources(rows):
    """Where printed values and trims come from."""
    records = [row[name] for row in rows for name in ("printed", "trim") if row[name] is not None]
    return "; ".join(sorted({one.source for one in records}))


def _draw(rows, requirement):
    """Three components over time, ours filled, printed hollow, trims as lines."""
    figure, panels = grid(3, 1, 4.9, sharex=True, margins={"hspace": 0.12, "bottom": 0.07})
    for index, axis in enumerate(AXES):
        panel = panels[index, 0]
        panel.axhspan(-requirement, requirement, color=COLOURS["sky"], alpha=0.13, linewidth=0, label="requirement")
        _series(panel, rows, index)
        for row in [row for row in rows if row["trim"] and row["trim"].axis == axis]:
            _mark_trim(panel, row["trim"])
        panel.set_ylabel(f"{axis} (µm)")
        panel.margins(y=0.12)
    panels[0, 0].set_title("offset, proof mass to CoM")
    legend(figure, panels[0, 0], 3)
    return figure


def _series(panel, rows, index):
    """Printed and own values of one component."""
    known = [row for row in rows if row["printed"] and row["printed"].value[index] is not None]
    panel.errorbar(
        [row["date"] for row in known],
        [row["printed"].value[index] for row in known],
        yerr=[row["printed"].sigma[index] for row in known],
        color=COLOURS["blue"],
        marker="o",
        markersize=3.8,
        markerfacecolor="white",
        linewidth=0.7,
        elinewidth=0.8,
        label="printed",
    )
    own = [row for row in rows if row["ours"] and row["ours"]["offset_um"][index] is not None]
    panel.errorbar(
        [row["date"] for row in own],
        [row["ours"]["offset_um"][index] for row in own],
        yerr=[row["ours"]["sigma_total_um"][index] for row in own],
        color=COLOURS["vermilion"],
        marker="s",
        markersize=3.8,
        linestyle="none",
        elinewidth=1.0,
        capsize=2,
        label="gravcal, total error",
    )


def _mark_trim(panel, trim):
    """Line of a trim with its size; dotted where the series does not show it."""
    style = "--" if trim.confirmed else ":"
    panel.axvline(trim.date, color=COLOURS["black"], linewidth=0.9, linestyle=style)
    place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "xytext": (3, -3)}
    text = f"trim {signed(trim.trim_um, 0)}" + ("" if trim.confirmed else ", not confirmed")
    panel.annotate(text, (trim.date, 1.0), va="top", fontsize=6.5, **place)
