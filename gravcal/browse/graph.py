"""Places of the boxes and lines of a chain of stages: columns from left to right, few crossings."""

WIDTH, HEIGHT = 138, 50  # of a box, px
ACROSS, DOWN = 158, 60  # from one box to the next, px
MARGIN = 6
SWEEPS = 6


def placed(nodes):
    """Boxes and lines of a chain.

    Parameters
    ----------
    nodes : list of shelf.Node

    Returns
    -------
    picture : dict: "width", "height", "boxes": list of (x, y, node), "lines": list of path texts
    """
    known = {node.key: node for node in nodes if node.key}
    depths = _depths(known)
    columns = {}
    for node in nodes:
        depth = depths[node.key] if node.key else max(depths.values(), default=-1) + 1
        columns.setdefault(depth, []).append(node)
    columns = [columns.get(depth, []) for depth in range(max(columns, default=-1) + 1)]
    rows = _ordered(columns)
    tallest = max((len(column) for column in columns), default=0)
    places = {}
    for depth, column in enumerate(columns):
        top = (tallest - len(column)) * DOWN / 2
        for node in column:
            places[id(node)] = (MARGIN + depth * ACROSS, MARGIN + top + rows[id(node)] * DOWN)
    lines = [
        _line(places[id(known[key])], places[id(node)], depths[node.key] - depths[key])
        for node in known.values()
        for key in node.inputs
        if key in known
    ]
    boxes = [(*places[id(node)], node) for column in columns for node in column]
    size = {"width": 2 * MARGIN + max(len(columns) - 1, 0) * ACROSS + WIDTH, "height": 2 * MARGIN + tallest * DOWN}
    return size | {"boxes": boxes, "lines": sorted(lines)}


def _depths(known):
    """Column of each product: one further than the furthest of its inputs."""
    depths = {}

    def depth(key):
        if key not in depths:
            depths[key] = 1 + max((depth(below) for below in known[key].inputs if below in known), default=-1)
        return depths[key]

    for key in known:
        depth(key)
    return depths


def _ordered(columns):
    """Row of each node in its column: at the mean of its neighbours, a few sweeps there and back."""
    rows = {id(node): row for column in columns for row, node in enumerate(column)}
    keys = {node.key: node for column in columns for node in column if node.key}
    beside = {id(node): [] for column in columns for node in column}
    for node in keys.values():
        for key in node.inputs:
            if key in keys:
                beside[id(node)].append(id(keys[key]))
                beside[id(keys[key])].append(id(node))
    size = {id(node): max(len(column), 1) for column in columns for node in column}
    for sweep in range(SWEEPS):
        for column in columns[:: 1 if sweep % 2 == 0 else -1]:
            wish = {id(n): _mean([(rows[o] + 0.5) / size[o] for o in beside[id(n)]], rows[id(n)]) for n in column}
            for row, node in enumerate(sorted(column, key=lambda n: (wish[id(n)], n.stage))):
                rows[id(node)] = row
    return rows


def _mean(values, otherwise):
    """Mean, or another value where there is none."""
    return sum(values) / len(values) if values else otherwise


def _line(start, stop, columns):
    """Curve from the right of one box to the left of another; one that passes columns bends late."""
    x, y = start[0] + WIDTH, start[1] + HEIGHT / 2
    u, v = stop[0], stop[1] + HEIGHT / 2
    bend = (ACROSS - WIDTH) * (0.5 if columns == 1 else 0.9)
    return f"M{x:.0f},{y:.0f} C{x + bend:.0f},{y:.0f} {u - bend:.0f},{v:.0f} {u:.0f},{v:.0f}"
