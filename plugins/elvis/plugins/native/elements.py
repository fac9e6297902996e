"""The elements of one part: their buffers, and the Slang types of all their quantities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints, concatenated, frozen_floats, frozen_ints, joined_columns
from elvis.core.base.threads import Once
from elvis.core.data.dataset import Homogeneous
from elvis.core.mapping.orientation import even_chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients
from elvis.core.polynomials.rounding import UNIT
from elvis.core.polynomials.weights import weights
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import Attributes, is_constant
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.evaluator import reference_values
from elvis.core.quantities.levels import Level, same_level
from elvis.core.quantities.tree import Node
from elvis.core.shapes import Shape
from elvis.plugins.native.device_spaces import degrees_of, even_space, field_space, type_arguments
from elvis.plugins.native.level_models import LevelModels
from elvis.plugins.native.maps import Keep, Maps, keep_nothing
from elvis.plugins.native.polynomials import Leaves, Net, expanded
from elvis.plugins.native.rounding import expression_rounding, field_rounding, operations, polynomial_rounding
from elvis.plugins.native.slopes import ElementSlopes, has_slopes
from elvis.plugins.native.solving import Solver
from elvis.plugins.native.waves import waves
from elvis.plugins.runtime.distances import buffers_of
from elvis.plugins.runtime.formulas import Formula, facets_of, ideal_of, is_continuous, is_distance
from elvis.plugins.runtime.volume import Enclosure, LevelSeries, Part, Quantity, SlopeBounds

#: highest degree of expressions whose isosurfaces are found as isosurfaces of polynomials
HIGHEST = 8
#: the same limit in straight tetrahedra, for expressions that only isosurfaces use
HIGHEST_STRAIGHT = 16
#: relative rounding of the level of another expression
LEVEL_ROUNDING = 1e-15
#: limits of expanded expressions: degree, degree on straight tetrahedra, coefficients, coefficients relative to the
#: fields'
_MOST_DEGREES, _MOST_STRAIGHT, _MOST_NUMBERS, _MOST_TIMES = 16, 24, 1 << 25, 2
#: elements whose bounds are found together
_CELLS = 4096
#: numbers of an array that is made on the way
_AT_ONCE = 1 << 17


class Elements:
    """Elements of one shape with maps of one space.

    names        of the patches' fields
    expressions  the quantities; the first becomes the part's own field
    keep         caches results that depend only on the mesh: the earlier result of a key, or a new one
    in_all       elements of all data, of which these may be a part
    """

    def __init__(
        self,
        patches: Sequence[Patch],
        geometry: BernsteinSpace,
        names: Sequence[str],
        expressions: Sequence[Expression],
        attributes: Attributes,
        keep: Keep = keep_nothing,
        in_all: int = 0,
    ) -> None:
        self.patches, self.geometry, self.names = patches, geometry, tuple(names)
        self.expressions, self.attributes, self._keep, self._in_all = expressions, attributes, keep, in_all
        self._nets: dict[tuple[str, ...], tuple[BernsteinSpace, Floats]] = {}
        self._surface_buffers: dict[tuple[str, ...], Mapping[str, NDArray[Any]]] = {}

    def part(self) -> Part:
        """The part: fields are evaluated directly, quantities of several fields from one stack of them all."""
        shape, ids = self.geometry.shape, concatenated([p.element_ids for p in self.patches])
        lengths = self.series.lengths if self.series else ()
        key = "maps", self.geometry, lengths, ids.tobytes()
        with self._keep(key, Once).started(lambda: Maps.of(self.patches, self.geometry)) as found:
            quantities = {expression.text: self._quantity(expression) for expression in self.expressions}
            maps = found()
        buffers: dict[str, NDArray[Any]] = {"control_points": maps.points, "control_indices": maps.indices}
        buffers |= self._buffers_of_waves()
        own = quantities[self.expressions[0].text]
        buffers |= own.buffers
        buffers.setdefault("coefficients", np.zeros(1))
        solver = Solver(self.patches, self._value)
        return Part(
            module=f"native_{shape.name.lower()}",
            shape=None if self.series else shape,
            type=own.type,
            element_ids=frozen_ints(ids),
            boxes=maps.boxes,
            buffers=buffers,
            solve=None if self.series else solver,
            source=own.source,
            bends=None if self._is_affine or self.series else solver.bends,
            quantities=quantities,
            degree=own.degree,
            base_degree=own.base_degree,
            collapsed=shape is Shape.PYRAMID,
            affine=self._is_straight,
            bounds=own.bounds,
            is_distance=own.is_distance,
            level=own.level,
            rounding=own.rounding,
            enclosure=own.enclosure,
            slopes=own.slopes,
            level_boxes=own.level_boxes,
        )

    def stack(self, names: tuple[str, ...]) -> Part:
        """The elements with several fields: number e M + m of the type has field m of M on the map of element e.

        The part has ids, boxes and buffers only.
        """
        space, net = self._net(names)
        type, source = self._type(space)
        maps = Maps.of(self.patches, self.geometry)
        buffers: dict[str, NDArray[Any]] = {"control_points": maps.points, "control_indices": maps.indices}
        buffers["coefficients"] = net
        ids = np.concatenate([patch.element_ids for patch in self.patches])
        return Part(f"native_{self.geometry.shape.name.lower()}", type, ids, maps.boxes, buffers, source=source)

    @cached_property
    def series(self) -> Homogeneous | None:
        """The Fourier series along z that the fields have."""
        found = (own.homogeneous for patch in self.patches for own in patch.fields if own is not None)
        return next((series for series in found if series), None)

    def _quantity(self, expression: Expression, stands_for: Level | None = None) -> Quantity:
        """The type and buffers of an expression on these elements, or of one that stands for another's level."""
        spurious = None if stands_for is None else stands_for.spurious
        is_expanded = not (expression.is_field or self.series or spurious)
        polynomial = self._expand(expression) if is_expanded else None
        if polynomial is not None:
            return self._of_net(polynomial)
        product = self._of_product(expression, spurious) if spurious and self._is_straight else None
        if product is not None:
            return product
        names = expression.fields if len(expression.fields) < 2 else self._several
        space, net = self._net(names)
        shape = self.geometry.shape
        type, source = self._type(space)
        buffers: dict[str, NDArray[Any]] = {"coefficients": net} if names else {}
        if expression.is_field:
            if self.series:
                return Quantity(type, source, buffers)
            error = cache(partial(self._rounding, names))
            degree, base = degrees_of(self.geometry, space)
            own_bounds = partial(_bounds, net, space, error)
            return Quantity(type, source, buffers, degree, own_bounds, rounding=error, base_degree=base)
        ideal = ideal_of(shape), shape.dimension + self._directions
        found = expression.degree(lambda leaf: self._degree(leaf, space))
        highest = HIGHEST_STRAIGHT if stands_for and self._is_straight else HIGHEST
        is_beyond = found is None or found > highest or self.series or spurious
        known = 0 if is_beyond or found is None else max(*self.geometry.degrees, found)
        matrix = () if stands_for is None else stands_for.matrix
        certify = cache(partial(self._certify, expression))
        is_finite = not known and self._is_finite(expression, certify)
        formula = Formula(expression, names, *ideal, facets_of(shape), spurious, matrix, is_finite)
        buffers |= {"element_constants": self._constants(formula.constants), **self._surfaces(formula.targets)}
        bounds = certify if (stands_for or not known) and not self.series else None
        plain = is_distance(expression.root)
        rounding = cache(partial(self._rounding_of, expression)) if known else None
        enclosure = None if known or self.series or plain else self._enclosure(formula, type, space)
        level = None if known or plain else partial(self._level, expression)
        type, source = f"Expressed<{type}, Given>", f"{source} {formula.source}"
        steepness = None if known else self._slope_bounds(expression)
        boxes = None if enclosure is None else self._boxes(expression, space, certify, spurious)
        return Quantity(
            type, source, buffers, known, bounds, plain, level, rounding, enclosure, slopes=steepness, level_boxes=boxes
        )

    def _boxes(
        self,
        expression: Expression,
        space: BernsteinSpace,
        ends: Callable[[], tuple[Floats, Floats]],
        condition: Node | None,
    ) -> Callable[[float], LevelSeries] | None:
        """Boxes as in Quantity.boxes, for an expression whose fields lie in a space."""
        errors = partial(self._leaf_errors, expression.fields)
        models = LevelModels(self.patches, self.geometry, space, self.names, expression, ends, errors, condition)
        return models.boxes if models.is_known else None

    def _type(self, space: BernsteinSpace) -> tuple[str, str]:
        """The Slang type of elements with this map and fields in a space, and the imports that it needs."""
        shape, arguments = self.geometry.shape, self._all_arguments(space)
        type = f"{shape.label}<{arguments}>"
        if not self.series:
            return type, ""
        planes = len(self.series.z_ids)
        if shape is Shape.SEGMENT:
            return f"Segment<{arguments}, {planes}, {len(self.series.lengths)}>", ""
        return f"Planes<{type}, {planes}>", "import native_planes;"

    def _is_finite(self, expression: Expression, certify: Callable[[], tuple[Floats, Floats]]) -> bool:
        """Whether an expression on solid elements that is continuous where it is finite is known to be so in all."""
        root = expression.root
        is_open = is_continuous(root, is_finite=True) and not is_continuous(root, is_finite=False)
        if self.series or self.geometry.shape.dimension < 3 or not is_open:
            return False
        return bool(np.isfinite(certify()).all())

    def _enclosure(self, formula: Formula, type: str, space: BernsteinSpace) -> Enclosure | None:
        """Enclosures of the leaves of a formula, on solid elements."""
        shape, names = self.geometry.shape, tuple(formula.fields)
        if shape.dimension < 3 or not formula.is_bounded:
            return None
        kinds = formula.kinds
        return Enclosure(
            f"LeavesOf<{type}, Given>",
            len(names),
            *degrees_of(self.geometry, space),
            map_degree=max(self.geometry.degrees),
            is_total=shape is Shape.TETRAHEDRON,
            errors=cache(partial(self._leaf_errors, names)),
            distances=kinds["distances"],
            continuous=kinds["continuous"],
            slopes=kinds["slopes"],
        )

    def _slope_bounds(self, expression: Expression) -> SlopeBounds | None:
        """Bounds of an expression's derivatives; not in curved surfaces."""
        is_solid = all(patch.is_flat and patch.shape.dimension > 1 for patch in self.patches)
        if self.series or not is_solid or not has_slopes(expression.root):
            return None
        space, errors = self._net(expression.fields)[0], cache(partial(self._leaf_errors, expression.fields))
        found = ElementSlopes(self.patches, self.geometry, self.names, expression, space, errors)
        return SlopeBounds(max(self.geometry.degrees), found.of, found.in_boxes)

    def _leaf_errors(self, names: tuple[str, ...]) -> Floats:
        """(n, 3 + fields) how far computed values of x, y, z and fields may be from the true ones in each element."""
        space, found = self._net(names)[0], []
        for patch in self.patches:
            maps = [patch.geometry_coefficients[:, axis] for axis in range(3)]
            coordinates = [polynomial_rounding(patch.geometry, modal, self.geometry) for modal in maps]
            fields = [self._leaf_error(patch, self.names.index(name), space) for name in names]
            found.append(np.stack([*coordinates, *fields], axis=1))
        return frozen_floats(np.concatenate(found))

    def _leaf_error(self, patch: Patch, number: int, space: BernsteinSpace) -> Floats:
        """Rounding (n,) of one of a patch's fields; NaN on elements that lack it."""
        expansion, modal = patch.fields[number], patch.coefficients[number]
        if expansion is None or modal is None:
            return np.full(len(patch), np.nan)
        return polynomial_rounding(expansion, modal, space)

    def _of_net(self, net: Net) -> Quantity:
        """The quantity that polynomials are: a field like any other, whatever expression they are of."""
        space = net.space
        rounding = net.error + UNIT * operations(space) * net.size
        coefficients = np.ascontiguousarray((net.coefficients * weights(space)[:, None]).T)
        bounds = partial(_bounds, coefficients, space, lambda: rounding)
        type = f"{space.shape.label}<{self._all_arguments(space)}>"
        degree, base = degrees_of(self.geometry, space)
        own = {"coefficients": coefficients}
        return Quantity(type, "", own, degree, bounds, rounding=lambda: rounding, base_degree=base)

    def _of_product(self, expression: Expression, spurious: Node) -> Quantity | None:
        """A product, and under which condition its zeros count, as two fields of each element; None: see `_expand`."""
        nets = [self._expand(each) for each in (expression, Expression(f"{expression.text} unless", spurious))]
        product, condition = nets
        if product is None or condition is None:
            return None
        degrees = tuple(map(max, product.space.degrees, condition.space.degrees))
        space = BernsteinSpace(self.geometry.shape, degrees)
        quantities = [self._of_net(net.elevate(space)) for net in (product, condition)]
        both = np.stack([each.buffers["coefficients"] for each in quantities], axis=1)
        shown, unless = (
            replace(
                each,
                type=f"Stacked<{each.type}, {number}, 2>",
                source="import stacked;",
                buffers={"coefficients": both},
            )
            for number, each in enumerate(quantities)
        )
        return replace(shown, condition=unless)

    def _all_arguments(self, space: BernsteinSpace) -> str:
        """Arguments of the Slang type of elements with this map and a field in a space."""
        return ", ".join(map(str, type_arguments(self.geometry) + type_arguments(space)))

    def _expand(self, expression: Expression) -> Net | None:
        """The polynomials that an expression is on these elements; None where it is none, or one of too many terms."""
        count = sum(map(len, self.patches))
        plans = [self._net_in(patch, np.zeros(0, np.int64), expression) for patch in self.patches]
        spaces = [plan.space for plan in plans if plan is not None]
        if len(spaces) < len(plans):
            return None
        degrees = tuple(map(max, zip(*(space.degrees for space in spaces), strict=True)))
        space = even_space(BernsteinSpace(self.geometry.shape, degrees), 0)
        most = _MOST_STRAIGHT if self._is_straight else _MOST_DEGREES
        numbers = [self.names.index(name) for name in expression.fields]
        own = sum(len(patch) * field_space(patch, number).count for patch in self.patches for number in numbers)
        is_many = space.count * max(self._in_all, count) > _MOST_NUMBERS and space.count * count > _MOST_TIMES * own
        if max(space.degrees) > most or is_many:
            return None
        nets = []
        for patch in self.patches:
            for rows in np.array_split(np.arange(len(patch)), -(-len(patch) // _CELLS)):
                net = self._net_in(patch, rows, expression)
                if net is None:
                    return None
                nets.append(net.elevate(space))
        coefficients = np.concatenate([net.coefficients for net in nets], axis=1)
        return Net(space, coefficients, np.concatenate([net.error for net in nets]))

    def _net_in(self, patch: Patch, rows: Ints, expression: Expression) -> Net | None:
        """The polynomials of an expression on some elements of a patch."""
        leaves = Leaves(patch, rows, self.names, self.attributes)
        return expanded(expression.root, leaves.net)

    def _level(self, expression: Expression, value: float) -> tuple[Quantity, float] | None:
        """Level as in Quantity.level, for an expression."""
        found = same_level(expression.root, value)
        if found is None:
            return None
        quantity = self._quantity(Expression(f"{expression.text} at {value!r}", found.root), found)
        if not quantity.degree:
            return (quantity, found.value) if quantity.enclosure and quantity.enclosure.continuous else None
        rounding = quantity.rounding
        assert rounding is not None
        return replace(quantity, rounding=lambda: rounding() + LEVEL_ROUNDING * abs(found.value)), found.value

    def _certify(self, expression: Expression) -> tuple[Floats, Floats]:
        """(n,) what an expression is not less and not greater than on each element, by interval arithmetic."""
        found = []
        for patch in self.patches:
            for rows in np.array_split(np.arange(len(patch)), -(-len(patch) // _CELLS)):
                cells = Cells.of(patch, self.names, self.attributes, rows, expression.order > 0)
                found.append(cells.bounds(expression.root))
        low, high = joined_columns(found)
        return low, high

    def _rounding(self, names: tuple[str, ...]) -> Floats:
        """(n,) how far computed values of a field may be from the true ones, in each element."""
        space = self._net(names)[0]
        return frozen_floats(np.concatenate([self._errors_in(patch, names[0], space) for patch in self.patches]))

    def _rounding_of(self, expression: Expression) -> Floats:
        """The same of an expression."""
        names = expression.fields if len(expression.fields) < 2 else self._several
        space, found = self._net(names)[0], []
        degree = max(*self.geometry.degrees, *space.degrees)
        for patch in self.patches:
            errors = {name: self._errors_in(patch, name, space) for name in expression.fields}
            for rows in np.array_split(np.arange(len(patch)), -(-len(patch) // _CELLS)):
                cells = Cells.of(patch, self.names, self.attributes, rows, expression.order > 0)
                own = {name: error[rows] for name, error in errors.items()}
                found.append(expression_rounding(expression.root, cells, own.__getitem__, degree))
        return frozen_floats(np.concatenate(found))

    def _errors_in(self, patch: Patch, name: str, space: BernsteinSpace) -> Floats:
        """(n,) the rounding of a field in the elements of a patch, not a number where they lack it."""
        number, found = self.names.index(name), np.full(len(patch), np.nan)
        expansion, modal = patch.fields[number], patch.coefficients[number]
        if expansion is None or modal is None:
            return found
        for part in even_chunks(len(patch), _AT_ONCE // space.count):
            with np.errstate(invalid="ignore"):
                scaled = bernstein_coefficients(expansion, modal[part], space) * weights(space)
            found[part] = field_rounding(expansion, modal[part], space, scaled / weights(space))
        return found

    def _degree(self, leaf: Node, space: BernsteinSpace) -> int | None:
        """The degree of a leaf of an expression, None if it is not a polynomial.

        Derivatives in the world are polynomials on straight simplices.
        """
        if leaf.op == "attribute":
            return 0 if is_constant(leaf.name) else None
        if leaf.axes and leaf.op == "field":
            return max(space.degrees) if self._is_affine and len(leaf.axes) == 1 else None
        return max(space.degrees if leaf.op == "field" else self.geometry.degrees)

    @property
    def _is_affine(self) -> bool:
        return self.geometry.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON) and max(self.geometry.degrees) == 1

    @property
    def _is_straight(self) -> bool:
        """Whether the elements are straight tetrahedra."""
        return self._is_affine and self.geometry.shape is Shape.TETRAHEDRON

    @cached_property
    def _several(self) -> tuple[str, ...]:
        """All fields of expressions that depend on more than one."""
        every = (each.fields for each in self.expressions if len(each.fields) > 1)
        return tuple(dict.fromkeys(name for names in every for name in names))

    def _net(self, names: tuple[str, ...]) -> tuple[BernsteinSpace, Floats]:
        """The smallest space for all of these fields, and their scaled coefficients (n, fields, waves, count)."""
        if names not in self._nets:
            numbers = [self.names.index(name) for name in names]
            spaces = [field_space(patch, number) for patch in self.patches for number in numbers]
            degrees = zip(*(space.degrees for space in spaces), strict=True)
            space = (
                BernsteinSpace(self.geometry.shape, tuple(map(max, degrees)))
                if names
                else field_space(self.patches[0], None)
            )
            planes = len(self.series.z_ids) if self.series else 1
            net = np.empty((sum(map(len, self.patches)), len(names), planes, space.count))
            rows = np.split(net, np.cumsum([len(patch) for patch in self.patches])[:-1])
            for patch, own in zip(self.patches, rows, strict=True):
                for column, number in enumerate(numbers):
                    _fill(own[:, column], patch, number, space)
            self._nets[names] = space, frozen_floats(net)
        return self._nets[names]

    def _constants(self, names: Sequence[str]) -> Floats:
        """Values (n, attributes) that are constant on each element."""
        columns = [[self.attributes.constant(name, p.shape, p.element_ids) for p in self.patches] for name in names]
        return np.stack([np.concatenate(column) for column in columns], axis=1) if columns else np.zeros((1, 1))

    def _surfaces(self, targets: tuple[str, ...]) -> Mapping[str, NDArray[Any]]:
        """The buffers of surfaces that distances are measured to."""
        if targets and targets not in self._surface_buffers:
            self._surface_buffers[targets] = buffers_of([self.attributes.surface(target) for target in targets])
        return self._surface_buffers.get(targets, {})

    def _value(self, patch: Patch, rows: Ints, reference: Floats) -> Floats:
        """(n,) the part's own field at reference points, on the host."""
        return reference_values(self.expressions[0], self.names, self.attributes, patch, rows, reference)

    @property
    def _directions(self) -> int:
        """Number of Fourier directions."""
        return len(self.series.lengths) if self.series else 0

    def _buffers_of_waves(self) -> dict[str, NDArray[np.float64]]:
        if not self.series:
            return {}
        return {"waves": waves(self.series), "period": np.array(self.series.lengths)}


def _bounds(net: Floats, space: BernsteinSpace, rounding: Callable[[], Floats]) -> tuple[Floats, Floats]:
    """(n,) minimum and maximum Bernstein coefficient of each element, apart by their rounding."""
    low, high = np.empty(len(net)), np.empty(len(net))
    for part in even_chunks(len(net), _AT_ONCE // space.count):
        plain = net[part].reshape(-1, space.count) / weights(space)
        plain.min(axis=1, out=low[part])
        plain.max(axis=1, out=high[part])
    error = rounding()
    return low - error, high + error


def _fill(net: Floats, patch: Patch, number: int, space: BernsteinSpace) -> None:
    """Fill scaled Bernstein coefficients of a field into (n, waves, count); NaN where the patch lacks the field.

    Elements are processed in chunks, so that intermediate results stay in the processor's cache.
    """
    expansion, modal = patch.fields[number], patch.coefficients[number]
    if expansion is None or modal is None:
        net[:] = np.nan
        return
    plain, planes = replace(expansion, homogeneous=None), net.shape[1]
    # infinities become NaN where they meet
    with np.errstate(invalid="ignore"):
        for part in even_chunks(len(patch), _AT_ONCE // (planes * space.count)):
            own = modal[part].reshape(-1, modal.shape[1] // planes)
            nets = bernstein_coefficients(plain, own, space).reshape(-1, planes, space.count)
            np.multiply(nets, weights(space), out=net[part])
