"""Option names of ParaView, PyVista, Matplotlib and GLVis, mapped to settings of a scene.

A name that can mean only one option is an alias of it; for every other name a hint says what to write.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

#: words that mean an option, by the names that keywords have in Python
SAME: Mapping[str, str] = {
    "slice": "plane",
    "scalars": "field",
    "cmap": "colormap",
    "color_map": "colormap",
    "clim": "range",
    "levels": "contours",
    "isosurfaces": "isosurface",
    "boundary": "faces",
    "boundaries": "faces",
    "show_edges": "mesh_lines",
    "alpha": "opacity",
    "window_size": "size",
    "image_size": "size",
    "background_color": "background",
    "camera_position": "camera",
    "cpos": "camera",
    "show_axes": "axes",
    "streamplot": "streamlines",
    "quiver": "glyphs",
    "arrows": "glyphs",
    "ssaa": "samples",
    "filename": "output",
    "screenshot": "output",
    "savefig": "output",
    "timestep": "step",
    "logo": "image",
    "annotate": "text",
}

#: what to write for words that need another value, or can mean several things
INSTEAD: Mapping[str, str] = {
    "iso": "isosurface draws surfaces where a quantity has a value",
    "isovalue": "isosurface draws surfaces where a quantity has a value",
    "stream": "streamlines=100 places seeds at random",
    "vectors": "glyphs draws arrows at points",
    "edges": "mesh_lines draws the edges of elements on surfaces",
    "mesh": "mesh_lines draws the edges of elements on surfaces",
    "grid": "axes draws axes with ticks, mesh_lines the edges of elements",
    "lut": "colormap takes the name of a colour map",
    "azimuth": "camera takes a view or eye:at; animate turns it with orbit",
    "contour": "contours draws lines, isosurface draws surfaces",
    "vmin": "range holds both ends, LOW:HIGH",
    "vmax": "range holds both ends, LOW:HIGH",
    "norm": "bar sets the scale: scale=log or scale=symlog",
    "log_scale": "bar sets the scale: scale=log",
    "logscale": "bar sets the scale: scale=log",
    "bands": "bar sets the number of colours: bands=8",
    "n_colors": "bar sets the number of colours: bands=8",
    "scalar_bar_args": "bar takes title=TEXT, unit=TEXT and others",
    "show_scalar_bar": "bar hides the colour bar with position=none; plain hides the title too",
    "colorbar": "bar describes the colour bar",
    "figsize": "size is the width and height in pixels",
    "resolution": "size is the width and height in pixels",
    "style": "mesh_lines draws the edges of elements on surfaces",
    "wireframe": "mesh_lines draws the edges of elements on surfaces",
    "edge_color": "mesh_lines takes a colour: objects[0].style.mesh_lines.color in set",
    "threshold": "clip hides a region, such as implicit:EXPRESSION",
    "clip_plane": "clip hides a region, such as plane:z=0.2",
    "normal": "plane takes a point and a normal, or z=0.2",
    "origin": "plane takes a point and a normal, or z=0.2",
    "view": "camera takes a named view, such as top or iso",
    "parallel_projection": "camera is orthographic unless it has a field of view",
    "parallel_scale": "zoom enlarges the middle; a camera in a scene has a height",
    "anti_aliasing": "samples averages N x N samples per pixel",
    "warp": "deform takes the components of a displacement, scale enlarges it",
    "subdivide": "pixels are exact without refinement",
    "nonlinear_subdivision": "pixels are exact without refinement",
    "refinement": "pixels are exact without refinement",
    "n_points": "streamlines=100 places seeds at random",
    "off_screen": "pictures are always drawn without a window; view opens one",
}

#: other names of views: planes as PyVista names them, axes that a view looks along
VIEWS: Mapping[str, str] = {
    "x": "+x",
    "y": "+y",
    "z": "+z",
    "xy": "top",
    "xz": "front",
    "yz": "right",
    "isometric": "iso",
}


def in_own_words(words: Sequence[str], known: Collection[str]) -> list[str]:
    """The words of a command line, with aliases listed in `SAME` replaced by the command's own options.

    known  the names of its options, with their hyphens
    """
    found: list[str] = []
    for number, word in enumerate(words):
        if word == "--":
            return [*found, *words[number:]]
        found.append(_own(word, known))
    return found


def _own(word: str, known: Collection[str]) -> str:
    """One word; an option may have its value behind an equals sign."""
    name, equals, value = word.partition("=")
    if not name.startswith("--") or name in known:
        return word
    own = SAME.get(name[2:].replace("-", "_"))
    option = "" if own is None else f"--{own.replace('_', '-')}"
    return f"{option}{equals}{value}" if option in known else word


def advice(name: str) -> str:
    """A hint for an unknown option; empty if no other program has an option of this name."""
    return INSTEAD.get(name.lstrip("-").replace("-", "_"), "")
