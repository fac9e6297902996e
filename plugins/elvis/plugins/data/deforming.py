"""Datasets on a deformed geometry, with the displacement as text: fields, expressions or a vector."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import texts_of
from elvis.core.data.complex_fields import components_of, missing_components
from elvis.core.data.dataset import Dataset, Field
from elvis.core.deformed.deformation import GRADIENTS, Deformation
from elvis.core.deformed.deforming import check_displacement, deformed, free_names, moving_maps, raised, undeformed
from elvis.core.mapping.geometry import geometry
from elvis.core.numbers.sampling import sample
from elvis.core.quantities.tree import AXES
from elvis.core.validity.folded import folded
from elvis.core.validity.largest_scale import LargestScale
from elvis.core.validity.largest_scale import largest_scale as bounds_of_scale
from elvis.plugins.data.added_quantities import QuantitySource, add_quantities, parse_quantities


def deform(
    dataset: Dataset, displacement: str = "", scale: float = 1.0, gradients: str = GRADIENTS[0], height: str = ""
) -> Dataset:
    """The dataset on the deformed geometry x + scale · d(x), which is exact: a polynomial map again.

    Parameters
    ----------
    dataset : Dataset
        Its fields keep their coefficients, and so stay with their material points.
    displacement : str
        The components of d, one for each coordinate, separated by commas: fields, or expressions that are
        polynomials of fields; or the name of a vector, such as ``displacement`` for the fields ``displacement_x`` and
        ``displacement_y``.
    scale : float
        Factor of the displacement.
    gradients : str
        Where derivatives of quantities are taken: ``undeformed`` (the default) or ``deformed``.
    height : str
        Instead of a displacement, for 2D data: the height u of the surface z = scale · u(x, y).

    Returns
    -------
    Dataset
        Its coordinates before the deformation are ``undeformed_x``, … in expressions.  Its remarks name the
        deformation, and elements that it folds.

    Raises
    ------
    ElvisError
        For another number of components than of coordinates, a component that is not a polynomial of fields, and data
        with Fourier directions.

    Examples
    --------
    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.deform(ds, "u,v", scale=0.5)
    <Dataset 2D: 1 triangle; fields u, v of order 1>
    """
    return with_deformation(dataset, Deformation(displacement, scale, gradients, height))


def with_deformation(dataset: Dataset, deformation: Deformation) -> Dataset:
    """The dataset on a deformed geometry."""
    dataset = undeformed(dataset)
    texts = texts_of_deformation(dataset, deformation)
    components = _fields(dataset, texts)
    if deformation.height:
        found = raised(dataset, components[0], deformation.scale, deformation.gradients)
    else:
        found = deformed(dataset, components, deformation.scale, deformation.gradients)
    assert found.deformation is not None
    own = replace(found.deformation, displacement=tuple(texts))
    faults = tuple(folded(found).sentences())
    told = (str(own), *_doubts(components), *faults)
    new = tuple(remark for remark in told if remark not in found.remarks)
    return replace(found, remarks=(*found.remarks, *new), deformation=replace(own, told=new, folds=bool(faults)))


def largest_scale(dataset: Dataset, displacement: str) -> LargestScale:
    """The smallest factor S > 0 at which x + S d(x) folds an element, enclosed by two proved bounds.

    Parameters
    ----------
    dataset : Dataset
        Elements of the dimension of space.
    displacement : str
        The components of d, as in `deform`.

    Returns
    -------
    LargestScale
        ``valid``: no element folds at any factor up to it.  ``folded``: a factor, larger by at most 1e-6, at which one
        does, with the element and the position; inf if none folds.

    Raises
    ------
    ElvisError
        As `deform`, and for surfaces and lines in space.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, d=[[0, -1, 0]], e=[[0, 0, 0]])
    >>> round(elvis.largest_scale(ds, "d,e").valid, 5)
    1.0
    """
    dataset = undeformed(dataset)
    texts = component_texts(dataset, displacement)
    components = _fields(dataset, texts)
    check_displacement(dataset, components)
    return bounds_of_scale(moving_maps(geometry(dataset), components), dataset.mesh.space)


def on_height(dataset: Dataset, points: Floats) -> Floats:
    """Points (n, 3) moved along z onto the surface z = S u(x, y); unchanged outside, and for other data."""
    known = dataset.deformation
    if known is None or not known.is_height or not len(points):
        return points
    text = known.displacement[0]
    in_plane = points * [1.0, 1.0, 0.0]
    heights = known.scale * sample(undeformed(dataset), text, in_plane)[text]
    is_inside = np.isfinite(heights)
    return np.column_stack([points[:, :2], np.where(is_inside, heights, points[:, 2])])


def is_deformed(dataset: Dataset, deformation: Deformation) -> bool:
    """Whether the geometry of a dataset is the requested one."""
    known = dataset.deformation
    if known is None:
        return False
    texts = tuple(texts_of_deformation(undeformed(dataset), deformation))
    asked = (texts, deformation.scale, deformation.gradients, bool(deformation.height))
    return (known.displacement, known.scale, known.gradients, known.is_height) == asked


def texts_of_deformation(dataset: Dataset, deformation: Deformation) -> list[str]:
    """The texts of all fields in a deformation."""
    return [deformation.height] if deformation.height else component_texts(dataset, deformation.displacement)


def component_texts(dataset: Dataset, displacement: str) -> list[str]:
    """The components in a text; a vector gives all of its components."""
    texts = texts_of(displacement) or []
    if not all(text.strip() for text in texts):
        raise ElvisError(f"--deform: expected a component between commas, such as u,v,w or u,0,w, found {displacement}")
    if len(texts) != 1 or dataset.mesh.space == 1:
        return texts
    known, space = tuple(dataset), dataset.mesh.space
    found = components_of(texts[0], known, space)
    if found or texts[0] in known:
        return found or texts
    missing = missing_components(texts[0], known, space)
    if missing:
        raise ElvisError(f"--deform: the vector {texts[0]} lacks the component {', '.join(missing)}")
    return texts


def _doubts(components: Sequence[Field]) -> Iterator[str]:
    """Remarks on a displacement with jumps."""
    broken = [own.name for own in components if own.continuous is False]
    if broken:
        names = ", ".join(broken)
        yield f"the displacement may jump between elements ({names}): there they separate or overlap"


def _fields(dataset: Dataset, texts: Sequence[str]) -> list[Field]:
    """The components as fields; ElvisError for one that is not a polynomial of fields on every element."""
    if len(texts) not in (1, dataset.mesh.space):
        # the number is reported before the fault of one of them
        return [Field(text, ()) for text in texts]
    names = free_names([f"displacement_{axis}" for axis in AXES], {field.name for field in dataset.fields})
    named = dict(zip(names, texts, strict=False))
    expressions = {name: text for name, text in named.items() if text not in dataset}
    if not expressions:
        return [dataset.field(text) for text in texts]
    quantities = [f"{name}={text}" for name, text in expressions.items()]
    source = QuantitySource(dataset, parse_quantities(dataset, quantities))
    for name, degrees in source.degrees.items():
        if None in degrees:
            raise ElvisError(
                f"--deform: expected fields, or polynomials of fields on every element, found {expressions[name]}; "
                "elvis convert --add makes a field of any quantity"
            )
    added = add_quantities(dataset, quantities).dataset
    # of what is made of other fields it isn't known whether it jumps
    own = {
        name: replace(added.field(name), name=text, continuous=added.field(name).continuous or None)
        for name, text in expressions.items()
    }
    return [own[name] if name in own else dataset.field(text) for name, text in named.items()]
