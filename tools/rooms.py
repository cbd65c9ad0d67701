"""Draw docs/images/rooms.svg: the folders of the package as boxes, the imports between them as arrows."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "srt3d_ros"
NOUNS = "Photons, Sketch, Cloud"       # the modules beside the folders
# Of each room: column, row, width in columns, and its content. Left out: errors.py and progress.py, which all import.
ROOMS = {
    "cli": (0, 0, 4, "the srt3d command"),
    "nodes": (0, 1, 1, "ROS 2 nodes"),
    "evaluation": (1, 1, 1, "methods against truth"),
    "review": (2, 1, 1, "report of a recording"),
    NOUNS: (0, 2, 2, "to read, reconstruct, save and plot"),
    "recording": (2, 3, 1, ".rrd recordings"),
    "datasets": (1, 3, 1, "photon files, simulator"),
    "messages": (1, 4, 1, "ROS messages ⇄ NumPy"),
    "pictures": (2, 4, 1, "drawn clouds, figures"),
    "processes": (3, 4, 1, "start and tune nodes"),
    "core": (0, 5, 3, "sensor · sketching · motion · method · baselines · metrics"),
    "files": (3, 5, 1, "safe reading and writing"),
    "kernels": (0, 6, 3, "the work of every pixel: numba (cpu), torch (GPU, oracle)"),
}
WIDTH, HEIGHT, ACROSS, DOWN, MARGIN = 178, 46, 200, 82, 12      # px: of a box; from box to box; around all
STYLE = """<style>text { font: 12px sans-serif; fill: #1f2a3a; text-anchor: middle }
.name { font-weight: bold; font-size: 14px } rect { fill: #e8eff9; stroke: #4a6fa5; rx: 6px }
line { stroke: #7488a8; stroke-width: 1.5; marker-end: url(#arrow) } path { fill: #7488a8 }</style>
<marker id="arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">
<path d="M0 0 8 4 0 8z"/></marker>"""


def drawing() -> str:
    """The SVG. An import has no arrow where a chain of arrows leads to the same room."""
    uses = {room: set(_used(room)) for room in ROOMS}
    lines, boxes = [], []
    for room, (column, row, columns, about) in ROOMS.items():
        left, top = MARGIN + column * ACROSS, MARGIN + row * DOWN
        width = (columns - 1) * ACROSS + WIDTH
        middle = left + width // 2
        boxes.append(f'<rect x="{left}" y="{top}" width="{width}" height="{HEIGHT}"/>'
                     f'<text class="name" x="{middle}" y="{top + 19}">{room}</text>'
                     f'<text x="{middle}" y="{top + 36}">{about}</text>')
        for other in sorted(uses[room] - {far for near in uses[room] for far in _below(near, uses)}):
            ends = _touched(room, other), top + HEIGHT, _touched(other, room), MARGIN + ROOMS[other][1] * DOWN
            lines.append('<line x1="{}" y1="{}" x2="{}" y2="{}"/>'.format(*ends))
    rows = max(row for _, row, *_ in ROOMS.values())
    size = f"{2 * MARGIN + 3 * ACROSS + WIDTH} {2 * MARGIN + rows * DOWN + HEIGHT}"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}">'
    return "\n".join([head, STYLE, *lines, *boxes, "</svg>\n"])


def _touched(room: str, other: str) -> float:
    """The x at which the arrow between two rooms touches the first one; on a wide room, in line with the other."""
    (own, _, own_width, _), (its, _, its_width, _) = ROOMS[room], ROOMS[other]
    column = own + (own_width - 1) / 2
    if own_width > its_width:
        column = min(its + (its_width - 1) / 2, own + own_width - 1)
    return MARGIN + column * ACROSS + WIDTH / 2


def _below(room: str, uses: dict[str, set[str]]) -> set[str]:
    """All rooms that a room imports, directly or not."""
    return uses[room].union(*(_below(other, uses) for other in uses[room]))


def _used(room: str) -> Iterator[str]:
    """The rooms that a room imports directly. Imports inside functions count for the commands only."""
    nouns = [file for file in PACKAGE.glob("*.py") if file.stem not in ("__init__", "compat", "errors", "progress")]
    of_module = dict.fromkeys([file.stem for file in nouns], NOUNS)
    for file in nouns if room == NOUNS else (PACKAGE / room).rglob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for node in ast.walk(tree) if room == "cli" else tree.body:
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == PACKAGE.name:
                inside = node.module.split(".")[1:2] or [name.name for name in node.names]
                yield from {of_module.get(name, name) for name in inside} & (ROOMS.keys() - {room})
