"""docs/api.md, the reference page of what `import srt3d_ros` shows, from its signatures and docstrings."""

import inspect
import re
import textwrap
from collections.abc import Callable

from srt3d_ros import api

WIDTH = 120
FUNCTIONS = ("reconstruct", "photons", "sketch", "open")
CLASSES = {"Cloud": ("plot", "save", "range_image", "depth_image", "image", "within", "ordered"),     # and methods
           "Sketch": ("save", "load"), "Sensor": ("replace", "cropped", "range_m", "xyz"), "Photons": ("gated",),
           "InvalidInput": ()}
SECTIONS = ("Args", "Returns", "Raises")
HEAD = """\
# The library

<!-- Made by python -m tools.generate_docs from srt3d_ros/api.py and tools/api_page.py: change those. -->

Three lines from arrays to a cloud: `row`, `col` and `toa` have an entry for each photon, in any order and of any type
of number, of NumPy or torch; `irf` is the impulse response of laser and detector, one number for each bin. A notebook
goes through it step by step: [arrays.ipynb](arrays.ipynb).

```python
import srt3d_ros

cloud = srt3d_ros.reconstruct(row, col, toa, shape=(141, 141), num_bins=4613, bin_width_s=2e-12, irf=irf, fov_deg=11)
cloud.plot("cloud.png")
cloud.save("cloud.ply")
```

`cloud.xyz` has the points in metres, `cloud.range_image()` one range for each pixel, `cloud.notes` what had to be
assumed. Photons that are counted in bins, `cube[rows, cols, bins]`, say shape and number of bins themselves:

```python
cloud = srt3d_ros.reconstruct(counts=cube, bin_width_s=2e-12, irf=irf, surfaces=2)
```

Files and bags are opened, [whichever the format](photon-file.md):

```python
photons = srt3d_ros.open("head.npz")
cloud = srt3d_ros.reconstruct(photons, method="rt3d")
```

A sketch is all that has to be kept of the photons. Sketches of the same frequencies add, and windows of pixels are
sketches:

```python
sketch = srt3d_ros.sketch(photons)
sketch += srt3d_ros.sketch(photons, frequencies=sketch.frequencies)     # the photons of a second frame
sketch[20:120, 30:110].save("face.npz")
cloud = srt3d_ros.reconstruct(srt3d_ros.Sketch.load("face.npz"))
```

What must be said, and what is assumed:

| argument | if it is not given |
| --- | --- |
| `shape`, `num_bins`, `bin_width_s` | refused: a guess would be wrong in silence. Counts say the first two. \
Where bins alone matter, `bin_width_s=2 / 299792458` makes a bin a metre: x, y and z then count bins |
| `irf` | estimated from the photons, if they stand out: slightly broader than the truth, and all ranges are off by \
the same small part of its width |
| `irf_ref` | the peak of `irf` marks the depth |
| `fov_deg` or `projection` | a pinhole of 30° across the larger side |

A mistake is one line that names the argument, what it is and what was expected: `InvalidInput`, a `ValueError`."""


def page() -> str:
    """The page in Markdown: how to use it, then every function and class."""
    parts = [HEAD, "## Functions"]
    for name in FUNCTIONS:
        parts += [f"### {name}", _signature(name, getattr(api, name)), _markdown(inspect.getdoc(getattr(api, name)))]
    parts.append("## Classes")
    for name, methods in CLASSES.items():
        parts += [f"### {name}", *_class(getattr(api, name), methods)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _class(kind: type, methods: tuple[str, ...]) -> list[str]:
    """What a class is, its fields, those of what it builds upon too, and a line for each of these methods."""
    about, fields = _split(inspect.getdoc(kind))[0], {}
    for base in reversed([base for base in kind.__mro__ if base.__module__.startswith("srt3d_ros")]):
        fields |= _split(inspect.getdoc(base))[1].get("Args", {})
    lines = [_bullet(f"- `{name}{_arguments(getattr(kind, name))}`: {_first_line(getattr(kind, name))}")
             for name in methods]
    return [_filled(about), _listed(fields), "Methods:" * bool(lines), "\n".join(lines)]


def _signature(name: str, function: Callable) -> str:
    return "\n".join(["```text", *textwrap.wrap(f"{name}{_arguments(function)} -> {_returned(function)}", WIDTH,
                                                subsequent_indent=" " * (len(name) + 1)), "```"])


def _arguments(function: Callable) -> str:
    """The arguments as a call shows them: names and defaults."""
    signature = inspect.signature(function)
    bare = [one.replace(annotation=inspect.Parameter.empty) for one in signature.parameters.values()
            if one.name not in ("self", "cls")]
    return str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))


def _returned(function: Callable) -> str:
    kind = inspect.signature(function).return_annotation
    return "Sensor" if kind is api.Sensor else getattr(kind, "__name__", str(kind))


def _first_line(method: Callable) -> str:
    return " ".join(_split(inspect.getdoc(method))[0].split("\n\n")[0].split())


def _split(doc: str | None) -> tuple[str, dict[str, dict[str, str]]]:
    """The text of a docstring before its sections, and the entries of each section."""
    parts = re.split(rf"^({'|'.join(SECTIONS)}):$", doc or "", flags=re.MULTILINE)
    sections = {}
    for title, body in zip(parts[1::2], parts[2::2]):
        body = textwrap.dedent(body.strip("\n"))
        entries = re.split(r"^(?=\S)", body, flags=re.MULTILINE)[1:]
        named = [entry.partition(": ") for entry in entries]
        sections[title] = {name if colon else "": " ".join((text if colon else name).split())
                           for name, colon, text in named}
    return parts[0].strip(), sections


def _markdown(doc: str) -> str:
    about, sections = _split(doc)
    parts = [_filled(about)]
    for title, entries in sections.items():
        parts.append(_listed(entries) if title == "Args" else _bullet(
            f"{title}: " + "; ".join(f"`{name}`: {text}" if title == "Raises" else f"{name}: {text}".removeprefix(": ")
                                     for name, text in entries.items())))
    return "\n\n".join(parts)


def _listed(entries: dict[str, str]) -> str:
    """A list of arguments or fields; `a, b` are two of them."""
    return "\n".join(_bullet(f"- {', '.join(f'`{one}`' for one in name.split(', '))}: {text}")
                     for name, text in entries.items())


def _bullet(text: str) -> str:
    return textwrap.fill(text, WIDTH, subsequent_indent="  " * text.startswith("- "), break_long_words=False,
                         break_on_hyphens=False)


def _filled(text: str) -> str:
    """Paragraphs refilled; indented ones, equations, as they are."""
    return "\n\n".join(part if part.startswith(" ") else _bullet(" ".join(part.split())) for part in text.split("\n\n"))
