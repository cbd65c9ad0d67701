"""docs/images/rooms.svg: the folders of the package as boxes, their imports as arrows."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "srt3d_ros"
# Of each room: column, row, width in columns, and what is in it. Helpers that all rooms use are left out.
ROOMS = {
    "cli": (0, 0, 4, "the srt3d command"),
    "nodes": (0, 1, 1, "ROS 2 nodes"),
    "api.py": (1, 1, 1, "read, reconstruct"),
    "evaluation": (2, 1, 1, "methods against truth"),
    "review": (3, 1, 1, "report of a recording"),
    "recording": (0, 2, 1, ".rrd, .ply files"),
    "pictures": (3, 2, 1, "drawn clouds, curves"),
    "datasets": (1, 3, 1, "files, bags, simulator"),
    "messages": (0, 4, 1, "ROS messages ⇄ NumPy"),
    "core": (0, 5, 4, "sensor · sketching · motion · method · baselines · metrics"),
    "kernels": (0, 6, 4, "the work of every pixel: numba (cpu), torch (GPU, oracle)"),
}
WIDTH, HEIGHT, ACROSS, DOWN, MARGIN = 178, 46, 200, 82, 12      # of a box; from box to box; px
STYLE = """<style>text { font: 12px sans-serif; fill: #1f2a3a; text-anchor: middle }
.name { font-weight: bold; font-size: 14px } rect { fill: #e8eff9; stroke: #4a6fa5; rx: 6px }
line { stroke: #7488a8; stroke-width: 1.5; marker-end: url(#arrow) } path { fill: #7488a8 }</style>
<marker id="arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">
<path d="M0 0 8 4 0 8z"/></marker>"""


def drawing() -> str:
    """The SVG. An arrow is left out where others lead the same way."""
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
            ends = _middle(room, other), top + HEIGHT, _middle(other, room), MARGIN + ROOMS[other][1] * DOWN
            lines.append('<line x1="{}" y1="{}" x2="{}" y2="{}"/>'.format(*ends))
    size = f"{2 * MARGIN + 3 * ACROSS + WIDTH} {2 * MARGIN + 6 * DOWN + HEIGHT}"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}">'
    return "\n".join([head, STYLE, *lines, *boxes, "</svg>\n"])


def _middle(room: str, other: str) -> float:
    """Where an arrow between both touches a room: in its middle, or of a wide one above or below the other."""
    (own, _, own_width, _), (its, _, its_width, _) = ROOMS[room], ROOMS[other]
    column = its + (its_width - 1) / 2 if own_width > its_width else own + (own_width - 1) / 2
    return MARGIN + column * ACROSS + WIDTH / 2


def _below(room: str, uses: dict[str, set[str]]) -> set[str]:
    return uses[room].union(*(_below(other, uses) for other in uses[room]))


def _used(room: str) -> Iterator[str]:
    """The rooms that a room imports; of what it imports on demand only, if it is the command."""
    place = PACKAGE / room
    for file in place.rglob("*.py") if place.is_dir() else [place]:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for node in ast.walk(tree) if room == "cli" else tree.body:
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == PACKAGE.name:
                inside = node.module.split(".")[1:2] or [name.name for name in node.names]
                for name in inside:
                    yield from {name, f"{name}.py"} & (ROOMS.keys() - {room})
