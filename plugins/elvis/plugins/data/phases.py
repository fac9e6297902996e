"""Complex fields at a phase: fields E = Re(E exp(i phase)), exact linear combinations of their two parts."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import frozen_floats, frozen_ints, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.complex_fields import ComplexChoice, Pairs, cosine_and_sine, named_pairs, pairs_in
from elvis.core.data.conversion_errors import REPORT, ConversionErrors
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.polynomials.grouping import grouped
from elvis.plugins.data.added_quantities import add_quantities, recorded_facts


def with_complexes(dataset: Dataset, choice: ComplexChoice) -> Dataset:
    """The dataset with the complex fields that a user names, and at the phase that he asks for."""
    dataset = without_phase(dataset)
    found = {**dataset.complexes, **named_pairs(choice.named, tuple(dataset))}
    named = replace(dataset, complexes=found)
    return named if choice.phase is None else at_phase(named, choice.phase)


def at_phase(dataset: Dataset, degrees: float) -> Dataset:
    """The dataset with the real part of every complex field at a phase.

    Parameters
    ----------
    dataset : Dataset
        It has complex fields: pairs such as ``E_re`` and ``E_im``, or pairs that are named.
    degrees : float
        The phase.  The field E is the real part of E exp(i phase).

    Returns
    -------
    Dataset
        With the fields in addition; ``phase`` is a number in expressions.

    Raises
    ------
    ElvisError
        If there is no complex field.

    >>> wave = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, E_re=[[1, 1, 1]], E_im=[[0, 0, 0]])
    >>> round(elvis.at_phase(wave, 180.0)["E"](0.2, 0.2), 12)
    -1.0
    """
    dataset = without_phase(dataset)
    known = tuple(dataset)
    pairs = {**pairs_in(known), **dataset.complexes}
    if not pairs:
        fields = f"the fields are {', '.join(known)}" if known else "the data contain no fields"
        raise ElvisError(f"--phase: expected pairs such as E_re and E_im, or --complex E=REAL,IMAGINARY; {fields}")
    found = dataset
    for name, pair in pairs.items():
        found = _with_field(found, name, pair, *cosine_and_sine(degrees))
    told = remark_of(degrees, pairs)
    metadata = _with_errors(dataset, pairs, *cosine_and_sine(degrees))
    return replace(found, complexes=pairs, phase=degrees, metadata=metadata, remarks=(*dataset.remarks, told))


def without_phase(dataset: Dataset) -> Dataset:
    """The dataset without the fields that `at_phase` has added."""
    if dataset.phase is None:
        return dataset
    told = remark_of(dataset.phase, dataset.complexes)
    fields = tuple(own for own in dataset.fields if own.name not in dataset.complexes)
    remarks = tuple(remark for remark in dataset.remarks if remark != told)
    return replace(dataset, fields=fields, remarks=remarks, phase=None)


def remark_of(degrees: float, pairs: Pairs) -> str:
    """A remark on the meaning of the fields of complex names."""
    parts = f"real parts at the phase {degrees:.10g} degrees, Re(E exp(i phase))"
    return f"complex fields are shown as their {parts}: {', '.join(pairs)}"


def _with_field(dataset: Dataset, name: str, pair: tuple[str, str], cosine: float, sine: float) -> Dataset:
    """The dataset with cosine · Re - sine · Im as a further field."""
    real, imaginary = dataset.field(pair[0]), dataset.field(pair[1])
    is_continuous = real.continuous and imaginary.continuous
    blocks = list(_combined(dataset, real, imaginary, cosine, sine))
    if None not in blocks:
        own = tuple(block for block in blocks if block is not None)
        return replace(dataset, fields=(*dataset.fields, Field(name, own, is_continuous)))
    # the parts have different bases on some elements: a projection finds one that holds both
    text = f"{name}={cosine!r}*{pair[0]}-{sine!r}*{pair[1]}"
    added = add_quantities(dataset, [text]).dataset.field(name)
    return replace(dataset, fields=(*dataset.fields, replace(added, continuous=is_continuous)))


def _combined(dataset: Dataset, real: Field, imaginary: Field, cosine: float, sine: float) -> Iterator[Block | None]:
    """Blocks of the combination on elements that have both parts; None for parts in different bases."""
    ids = np.unique(joined_ints(block.element_ids for block in real.blocks))
    if not len(ids):
        return
    for group in grouped(ids, [real.blocks, imaginary.blocks]):
        spaces, (of_real, of_imaginary) = group.expansions, group.coefficients
        if of_real is None or of_imaginary is None or spaces[0] is None:
            continue
        if spaces[0] != spaces[1]:
            yield None
            continue
        values = cosine * of_real - sine * of_imaginary
        yield Block(spaces[0], frozen_ints(group.element_ids), frozen_floats(values))


def _with_errors(dataset: Dataset, pairs: Pairs, cosine: float, sine: float) -> dict[str, str]:
    """The metadata, with the errors of a conversion in the combinations of converted fields."""
    errors = ConversionErrors.of(dataset.metadata)
    metadata = dict(dataset.metadata)
    if not errors:
        return metadata
    facts = recorded_facts(metadata)
    known = facts["fields"]
    found = {}
    for name, (real, imaginary) in pairs.items():
        losses = errors.of_field(real), errors.of_field(imaginary)
        inexact = next((known[part] for part in (real, imaginary) if part in errors.fields), None)
        if inexact is None:
            continue
        shares = abs(cosine), abs(sine)
        sums = {
            "max": sum(share * loss.value for share, loss in zip(shares, losses, strict=True)),
            "slope": sum(share * loss.slope for share, loss in zip(shares, losses, strict=True)),
            "relative": max(loss.relative for loss in losses),
            "L2": None,
        }
        finite = {key: value if value is not None and np.isfinite(value) else None for key, value in sums.items()}
        found[name] = {**inexact, **finite}
    facts["fields"] = {**known, **found}
    metadata[REPORT] = json.dumps(facts, allow_nan=False)
    return metadata
