"""The graph of nodes and topics as an SVG, drawn from the specs of the nodes; tools/generate_docs.py writes it.

From top to bottom: the sources of photons, then in turn the topics of a node and the node that subscribes to them, then
the robot. Nodes that only record are at the sides.
"""

from collections.abc import Iterable
from html import escape
from itertools import zip_longest

from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.topics import Topic

PILL, GAP = (158, 46), 10           # width and height of a topic; space between two
NODE, SOURCE = (300, 56), (240, 56)
SIDE, MARGIN, LANE = 150, 20, 94    # width of the boxes at the sides; margin; space between these boxes and topics
STEP = 52                           # between two rows
FONT = "font-family='DejaVu Sans, Verdana, sans-serif'"
MONO = "font-family='DejaVu Sans Mono, Menlo, Consolas, monospace'"
INK, DIM = "#1d2733", "#5c6b7a"
NODE_FILL, PILL_FILL, OUTSIDE = "#1f5b8f", "#e8f1f9", "#f1efe9"
DEVICE = "device"
CHAIN = ("player", "sketcher", "reconstructor")      # from top to bottom; the other nodes only record
ROBOT = "your robot: Nav2, RViz, octomap, …"
LEGEND = ("dashed: only at times (docs/nodes.md says when)     latched: late subscribers get it too     "
          "every node: /diagnostics, once a second")


def draw(specs: Iterable[NodeSpec]) -> str:
    """The graph of these nodes as the text of an SVG file."""
    by_name = {spec.name: spec for spec in specs}
    chain = [by_name.pop(name) for name in CHAIN]
    rows = _rows(chain)
    middle = MARGIN + SIDE + LANE + (max(map(len, rows)) * (PILL[0] + GAP) - GAP) / 2
    sources = {spec.name: spec.outputs for spec in (by_name.pop(DEVICE), chain[0])}
    places = dict(zip(("your driver", *sources), (middle + k * (SOURCE[0] + GAP) for k in (-1, 0, 1))))
    parts = [_box(x, MARGIN, SOURCE, name, *() if name in sources else (OUTSIDE,)) for name, x in places.items()]
    y, bands = MARGIN + NODE[1], []
    for row, reader in zip(rows, (*chain[1:], None)):
        pills_y, reader_y = y + STEP, y + 2 * STEP + PILL[1]
        xs = [middle + (k - (len(row) - 1) / 2) * (PILL[0] + GAP) for k in range(len(row))]
        for x, topic in zip(xs, row):
            starts = (middle,) if bands else [place for name, place in places.items() if name not in sources
                                              or topic.name in {one.name for one in sources[name]}]
            parts += [_curve(start, y, x, pills_y) for start in starts]
            parts += [_curve(x, pills_y + PILL[1], middle, reader_y, arrow=True), _pill(x, pills_y, topic)]
        parts.append(_box(middle, reader_y, NODE, reader.name) if reader else
                     _box(middle, reader_y, (1.5 * NODE[0], NODE[1]), ROBOT, OUTSIDE))
        bands.append((pills_y + PILL[1] / 2, xs, row))
        y = reader_y + NODE[1]
    for sink, side in zip(by_name.values(), (-1, 1)):
        parts += _sink(sink, side, 2 * middle, y, bands)
    parts.append(_text(middle, y + 36, LEGEND, FONT, 13, DIM))
    return _svg(2 * middle, y + 36 + MARGIN, parts)


def _rows(chain: list[NodeSpec]) -> list[list[Topic]]:
    """Below each node of the chain the topics that it publishes, and those of the driver for the node after it."""
    made = {topic.name for node in chain for topic in node.outputs}
    seen: set[str] = set()
    rows = []
    for node, reader in zip_longest(chain, chain[1:]):
        outside = [topic for topic in (reader.inputs if reader else ()) if topic.name not in made]
        topics = {topic.name: topic for topic in (*node.outputs, *outside) if not topic.name.startswith("/")}
        rows.append([topic for name, topic in topics.items() if name not in seen])
        seen |= set(topics)
    return rows


def _svg(width: float, height: float, parts: list[str]) -> str:
    """The file; lines come first, below everything else."""
    head = (f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width:g} {height:g}' width='{width:g}' "
            f"height='{height:g}'>\n<rect width='{width:g}' height='{height:g}' rx='10' fill='#ffffff'/>\n"
            f"<defs><marker id='tip' viewBox='0 0 8 8' refX='7' refY='4' markerWidth='8' markerHeight='8' "
            f"orient='auto'><path d='M0 0 L8 4 L0 8 z' fill='{DIM}'/></marker></defs>")
    return "\n".join([head, *sorted(parts, key=lambda part: not part.startswith("<path")), "</svg>", ""])


def _sink(node, side: int, width: float, bottom: float, bands: list) -> list[str]:
    """A box at one side, with an arrow from each row with topics that it subscribes to."""
    left = MARGIN if side < 0 else width - MARGIN - SIDE
    edge = left + SIDE if side < 0 else left
    taken = {topic.name for topic in node.inputs}
    parts = [_box(left + SIDE / 2, MARGIN, (SIDE, bottom - MARGIN), node.name)]
    for y, xs, topics in bands:
        names = [topic.name for topic in topics if topic.name in taken]
        if not names:
            continue
        start = xs[0] - PILL[0] / 2 if side < 0 else xs[-1] + PILL[0] / 2
        parts.append(f"<path d='M{start:g} {y:g} L{edge - 2 * side:g} {y:g}' stroke='{DIM}' fill='none' "
                     "marker-end='url(#tip)'/>")
        if len(names) < len(topics):
            parts += [_text((start + edge) / 2, y - 8 - 15 * k, name, MONO, 12, DIM)
                      for k, name in enumerate(reversed(names))]
    return parts


def _box(x: float, y: float, size: tuple[float, float], name: str, fill: str = NODE_FILL) -> str:
    """A node, or something outside of the package; x is its middle, y its top."""
    width, height = size
    own = fill == NODE_FILL
    return (f"<rect x='{x - width / 2:g}' y='{y:g}' width='{width:g}' height='{height:g}' rx='8' fill='{fill}' "
            f"stroke='{NODE_FILL if own else DIM}'/>"
            + _text(x, y + height / 2 + 6, name, MONO if own else FONT, 18, "#ffffff" if own else INK, bold=True))


def _pill(x: float, y: float, topic) -> str:
    """A topic; dashed if it is published only at times."""
    dashes = " stroke-dasharray='5 4'" if topic.when else ""
    return (f"<rect x='{x - PILL[0] / 2:g}' y='{y:g}' width='{PILL[0]}' height='{PILL[1]}' rx='{PILL[1] / 2:g}' "
            f"fill='{PILL_FILL}' stroke='{NODE_FILL}'{dashes}/>"
            + _text(x, y + 20, topic.name, MONO, 14 if len(topic.name) < 18 else 13, INK, bold=True)
            + _text(x, y + 36, topic.type.split("/")[-1] + ", latched" * topic.latched, FONT, 12, DIM))


def _text(x: float, y: float, text: str, font: str, size: int, colour: str, bold: bool = False) -> str:
    weight = " font-weight='bold'" * bold
    return (f"<text x='{x:g}' y='{y:g}' {font} font-size='{size}'{weight} fill='{colour}' text-anchor='middle' "
            f"xml:space='preserve'>{escape(text)}</text>")


def _curve(x0: float, y0: float, x1: float, y1: float, arrow: bool = False) -> str:
    bend = (y1 - y0) / 2
    tip = " marker-end='url(#tip)'" if arrow else ""
    return (f"<path d='M{x0:g} {y0:g} C{x0:g} {y0 + bend:g} {x1:g} {y1 - bend:g} {x1:g} {y1:g}' fill='none' "
            f"stroke='{DIM}'{tip}/>")
