"""Writes docs/gallery.md: every picture with its scene and its command; `make pages` runs it."""

from __future__ import annotations

from pathlib import Path

from elvis.scene.files import read_scene

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "examples" / "scenes"
PAGE = ROOT / "docs" / "gallery.md"
HEAD = """<!-- made by tools/gallery_page.py from examples/scenes -->

# Gallery

Every picture is drawn by one command from one scene file of `examples/scenes`: `python examples/gallery.py NAME`.
"""
CHAPTERS = {
    "pages": "Solvers' own data",
    "street": "A vortex street",
    "cases": "Cases of the paper on the first ElVis",
}
SOURCES = {
    "pages": """Files that the solvers wrote, from their own tests and examples or computed for ours; they are not part
of this repository. The sentence above each picture says where they are from.""",
    "street": """The flow of a benchmark by Schäfer and Turek (1996): `python examples/street.py` computes it
with NGSolve, in some minutes.""",
    "cases": """Nelson, Liu, Kirby and Haimes (2012), regenerated: `python examples/cases.py` makes the data, the meshes
by Gmsh. The fields of the wings are analytic expressions, stated in `examples/delta.py` and `examples/wing.py`, not
solutions.""",
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
