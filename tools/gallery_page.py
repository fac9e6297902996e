"""Writes docs/gallery.md: every picture with its scene and its command; `make pages` runs it."""

from __future__ import annotations

from pathlib import Path

from elvis.scene.model.files import read_scene

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "examples" / "scenes"
PAGE = ROOT / "docs" / "gallery.md"
HEAD = """<!-- made by tools/gallery_page.py from examples/scenes -->

# Gallery

One command draws each picture from one scene file of `examples/scenes`. The command stands under
the picture; `python examples/gallery.py NAME` runs it for you.
"""
CHAPTERS = {
    "pages": "Solvers' own data",
    "street": "A vortex street",
    "cases": "Cases of the paper on the first ElVis",
}
SOURCES = {
    "pages": """The solvers wrote these files, for their own tests and examples or for ours. The files are not part
of this repository. The sentence above each picture states their origin.""",
    "street": """The flow is a benchmark by Schäfer and Turek (1996). `python examples/street.py` computes it
with NGSolve in some minutes.""",
    "cases": """These cases follow the paper of Nelson, Liu, Kirby and Haimes (2012). `python examples/cases.py`
makes the data; Gmsh makes the meshes. The fields of the wings are not solutions but analytic
expressions, stated in `examples/delta.py` and `examples/wing.py`.""",
}


def page() -> str:
    """A chapter for each folder of data."""
    scenes = sorted(SCENES.glob("*.toml"))
    lines = [HEAD]
    for folder, title in CHAPTERS.items():
        lines.append(f"\n## {title}\n\n{SOURCES[folder]}\n")
        lines += [_picture(path) for path in scenes if Path(read_scene(path).data[0]).parent.name == folder]
    return "\n".join(lines)


def _picture(path: Path) -> str:
    """A picture with its command and, folded, its scene."""
    text = path.read_text(encoding="utf-8")
    sentence = text.splitlines()[0].removeprefix("# ")
    return f"""### {path.stem}

{sentence}

![{sentence}]({path.stem}.png)

```text
elvis render examples/scenes/{path.name} -o {path.stem}.png
```

<details><summary>The scene</summary>

```toml
{text}```

</details>
"""


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
