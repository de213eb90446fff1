"""Figures of the reports: one style, colours that the colour-blind tell apart, bytes that depend on the data alone."""

import base64
import io

WIDTH_IN = 7.0
DPI = 170
#: Okabe and Ito, Color Universal Design, 2008.
COLOURS = {
    "black": "#000000",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "green": "#009E73",
    "yellow": "#F0E442",
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "purple": "#CC79A7",
    "grey": "#8A8A8A",
}
UNSAID = {"png": ("Software",), "svg": ("Date", "Creator", "Format", "Type")}
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # no search for room above the ticks: a tenth of the drawing time
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 0.9,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.2,
    "svg.hashsalt": "gravcal",
    "svg.fonttype": "path",
    "path.simplify": True,
}


def grid(rows, columns, height_in, **options):
    """Figure with its panels, always as a two-dimensional array.

    Parameters
    ----------
    rows, columns : number of panels
    height_in : inch
    options : of Figure.subplots; `margins`, {"left", "right", "top", "bottom", "hspace", "wspace"}

    Returns
    -------
    figure : Figure
    panels : (rows, columns) array of Axes
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    margins = options.pop("margins", {})
    figure = Figure(figsize=(WIDTH_IN, height_in))
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    ends = {"top": 1 - 0.36 / height_in, "bottom": 0.38 / height_in}
    figure.subplots_adjust(**({"left": 0.085, "right": 0.99} | ends | margins))
    return figure, panels


def legend(figure, panel, columns):
    """Legend of one panel above all panels, to the right.

    Parameters
    ----------
    figure : Figure
    panel : Axes with the labels
    columns : number
    """
    handles, labels = panel.get_legend_handles_labels()
    top = 1 - 0.02 / figure.get_figheight()
    figure.legend(handles, labels, ncols=columns, loc="upper right", bbox_to_anchor=(0.995, top), borderpad=0.0)


def image(draw, *given, form="png"):
    """Figure as a data address for an image in a page.

    Parameters
    ----------
    draw : function that returns a Figure
    given : its arguments
    form : "png", or "svg" for drawings with few points

    Returns
    -------
    address : str, "data:image/..."; None if `draw` has nothing to show
    """
    import matplotlib

    with matplotlib.rc_context(STYLE):
        figure = draw(*given)
        if figure is None:
            return None
        buffer = io.BytesIO()
        figure.savefig(buffer, format=form, dpi=DPI, metadata=dict.fromkeys(UNSAID[form]))
    kind = {"png": "image/png", "svg": "image/svg+xml"}[form]
    return f"data:{kind};base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
