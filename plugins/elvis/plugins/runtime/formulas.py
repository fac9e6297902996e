"""Expressions as Slang: the formulas of ``shaders/formula.slang``."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.mapping.margins import facets
from elvis.core.quantities.attributes import from_ideal, is_constant
from elvis.core.quantities.elements.sides import DUALS, SIDES
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import (
    LEAVES,
    ZERO,
    Node,
    direction_of,
    leaves,
    ordered,
    partial,
    target_of,
    whole_exponent,
)
from elvis.core.shapes import Shape

_FUNCTIONS: Mapping[str, str] = {
    "step": "before",
    "/": "divided",
    "^": "raised",
    "sqrt": "root",
    "log": "natural",
    "exp": "exponential",
    "sin": "sine",
    "cos": "cosine",
    "tan": "tangent",
    "asin": "arcsine",
    "acos": "arccosine",
    "atan": "arctangent",
    "atan2": "arctangent2",
    "sinh": "hyperbolic_sine",
    "cosh": "hyperbolic_cosine",
    "tanh": "hyperbolic_tangent",
    "abs": "absolute",
    "sign": "sign_of",
    "min": "least",
    "max": "greatest",
    "imaginary_root": "imaginary_root",
    "middle_eigenvalue": "middle_eigenvalue",
}

#: functions that are continuous everywhere, analytic except at kinks; and functions with this property where they are
#: finite
_CONTINUOUS = ("+", "-", "*", "exp", "sin", "cos", "sinh", "cosh", "atan", "tanh", "abs", "min", "max")
_WHERE_FINITE = ("/", "^", "sqrt", "log", "tan", "asin", "acos")
_WITH_DISCS = (*LEAVES, *_CONTINUOUS, *_WHERE_FINITE, "sign", "step", "atan2")

#: distances in an expression that is enclosed: numbers of a vector of `ILeaves.away`
MOST_DISTANCES = 3
#: parts of an expression that a kernel evaluates
_MOST = 1000
#: the largest power that kernels take by products; see ``power`` in ``shaders/elementary.slang``
_MOST_FACTORS = 1024

_SOURCE = """import formula; import elementary; import eigenvalues;
struct Given : IFormula
{{
    static bool has_frame() {{ return {has_frame}; }}
    static double at<V : IVolume>(uint element, double3 r, double3 about, Frame frame)
    {{
        {value}
    }}
    static double3 gradient<V : IVolume>(uint element, double3 r)
    {{
        {gradient}
    }}
    static double condition<V : IVolume>(uint element, double3 r, Frame frame)
    {{
        {condition}
    }}
    static double of(LeafJets leaves)
    {{
        {of}
    }}
    static Disc within(Leaves leaves, out Disc spurious)
    {{
        {within}
    }}
    static Slopes slopes(Leaves leaves)
    {{
        {slopes}
    }}
    static double3 away(double3 position)
    {{
        {away}
    }}
}}
"""


@dataclass(frozen=True)
class _Kind:
    """Representation of the parts of an expression in a kernel: numbers, or discs that contain all of their values.

    type   in Slang
    exact  converts the text of a number
    leaf   the text of a leaf that is not a number
    """

    type: str
    exact: Callable[[str], str]
    leaf: Callable[[Node], str]


@dataclass(frozen=True)
class Formula:
    """An expression as Slang.

    fields  names of the fields that each element has in V: number m of M belongs to V(e M + m)
    ideal   (3, 3) from the reference to the ideal element, for the quality
    facets  (k, 4) of the reference shape, as coefficients of x, y, z and 1; none if the shape isn't known
    spurious  optional: an expression that is positive where the level isn't to be shown
              (`elvis.core.quantities.levels`)
    matrix    optional: entries for a closer bound of the same (`elvis.core.quantities.levels`)
    is_finite  whether the expression is known to have neither poles nor points where it isn't defined
    """

    expression: Expression
    fields: Sequence[str]
    ideal: Floats
    dimension: int
    facets: Floats
    spurious: Node | None = None
    matrix: Sequence[Node] = ()
    is_finite: bool = False

    @property
    def constants(self) -> tuple[str, ...]:
        """The attributes that ``element_constants`` holds of each element, in this order."""
        return tuple(name for name in self.expression.attributes if is_constant(name))

    @property
    def targets(self) -> tuple[str, ...]:
        """Targets of its distances, in the order of the surfaces on a device."""
        found = (target_of(name) for name in self.expression.attributes)
        return tuple(dict.fromkeys(target for target in found if target is not None))

    @property
    def source(self) -> str:
        """Slang text that declares ``Given``, an IFormula; ElvisError where that would take minutes to compile."""
        parts = len(ordered(self.expression.root))
        if parts > _MOST:
            raise ElvisError(f"expected an expression of at most {_MOST} parts in pictures, found {parts}")
        bodies = {
            "has_frame": [str(self._has_frame(leaves(self.expression.root), ())).lower()],
            "value": self._value(),
            "gradient": self._gradient(),
            "condition": self._condition(),
            "of": self._of(),
            "within": self._within(),
            "slopes": self._slopes(),
            "away": self._away(),
        }
        text = _SOURCE.format(**{name: "\n        ".join(lines) for name, lines in bodies.items()})
        return f"import distances; {text}" if self.targets else text

    def _value(self) -> Iterator[str]:
        """The value at a point with a known frame."""
        yield from self._number(self.expression.root)

    def _condition(self) -> Iterator[str]:
        """The value of `spurious` at a point with a known frame."""
        if self.spurious is None:
            yield "return -1.0lf;"
        else:
            yield from self._number(self.spurious)

    def _number(self, root: Node) -> Iterator[str]:
        yield from self._ingredients(leaves(root), ())
        names = yield from self._statements(self._numbers, root)
        yield f"return {names[root]};"

    @property
    def is_enclosed(self) -> bool:
        """Whether discs of its values follow from discs of fields, first derivatives, coordinates and constants.

        Only without jumps and poles: sub-elements with one would be subdivided endlessly.  At kinks only sub-elements
        that also contain the level are subdivided: curves of them.  With distances, slopes of its values follow in the
        same way.
        """
        return self._has_known_leaves and all(is_continuous(r, self.is_finite) for r in self._enclosed)

    @property
    def is_bounded(self) -> bool:
        """Whether discs of its values follow in the same way, including poles and jumps."""
        return self._has_known_leaves and all(n.op in _WITH_DISCS for n in ordered(*self._enclosed))

    @property
    def _has_known_leaves(self) -> bool:
        if self.targets and (len(self._enclosed) > 1 or len(self.targets) > MOST_DISTANCES):
            return False
        return all(map(self._is_known, self._leaves))

    def _is_known(self, leaf: Node) -> bool:
        """Whether discs of a leaf are available; with distances, also of its gradient."""
        if leaf.op == "attribute":
            return is_constant(leaf.name) or is_distance(leaf)
        return leaf.op == "coordinate" or len(leaf.axes) <= (0 if self.targets else 1)

    @property
    def _enclosed(self) -> tuple[Node, ...]:
        """Expressions of which discs are requested."""
        others = self.matrix or ([] if self.spurious is None else [self.spurious])
        return (self.expression.root, *others)

    @property
    def _leaves(self) -> Sequence[Node]:
        return leaves(*self._enclosed)

    @property
    def kinds(self) -> Mapping[str, bool]:
        """Properties for an Enclosure: whether it has distances, jumps or poles, and derivatives of fields."""
        slopes = any(leaf.op == "field" and leaf.axes for leaf in self._leaves)
        return {"distances": bool(self.targets), "continuous": self.is_enclosed, "slopes": bool(slopes)}

    def _of(self) -> Iterator[str]:
        """The value by leaves at a point, which distances are none of."""
        if not self.is_enclosed or self.targets:
            yield "return not_a_number();"
            return
        yield "uint element = leaves.element;"
        yield "Frame frame = leaves.frame();"
        root = self.expression.root
        fields = [leaf for leaf in leaves(root) if leaf.op == "field"]
        for m in self._rows([leaf.name for leaf in fields if not leaf.axes]):
            yield f"double value{m} = leaves.field({m});"
        for m in self._rows([leaf.name for leaf in fields if leaf.axes]):
            yield f"double3 gradient{m} = in_world(frame, leaves.gradient({m}));"
        names = yield from self._statements(self._numbers, root)
        yield f"return {names[root]};"

    def _within(self) -> Iterator[str]:
        """The same of discs."""
        if not self.is_bounded:
            yield "spurious = anything();"
            yield "return anything();"
            return
        yield from self._gradient_discs(leaf for leaf in self._leaves if leaf.op == "field" and leaf.axes)
        names = yield from self._statements(self._discs, *self._enclosed)
        spurious = "Disc(-1.0lf)" if self.spurious is None else names.get(self.spurious)
        if self.matrix:
            entries = ", ".join(names[entry] for entry in self.matrix)
            spurious = f"leaves.real ? Symmetric({entries}).second_apart_from_zero() : anything()"
        yield f"spurious = {spurious};"
        yield f"return {names[self.expression.root]};"

    def _gradient_discs(self, fields: Iterable[Node]) -> Iterator[str]:
        """Gradient discs in the world: in a loop, as in _gather."""
        rows = self._rows([leaf.name for leaf in fields])
        if rows:
            numbers = f"static const int rows[{len(rows)}] = {{ {', '.join(map(str, rows))} }};"
            yield f"{numbers} Disc3 gradients[{len(rows)}];"
            yield f"[loop] for (int k = 0; k < {len(rows)}; ++k) gradients[k] = leaves.gradient(rows[k]);"
        for k, m in enumerate(rows):
            yield f"Disc3 gradient{m} = gradients[{k}];"

    def _slopes(self) -> Iterator[str]:
        """The chain rule over discs: the gradient while distances are held, and how much those count."""
        yield "Slopes slopes = Slopes();"
        parts = self._parts if self.is_enclosed and self.targets else {}
        yield from self._gradient_discs(leaf for leaf in parts if leaf.op == "field")
        names = yield from self._statements(self._discs, *parts.values())
        for leaf, part in parts.items():
            disc = names[part]
            if leaf.op == "attribute":
                yield f"slopes.held += {disc}.size() + {disc}.error;"
            elif leaf.op == "coordinate":
                axis = "xyz"[leaf.axes[0]]
                yield f"slopes.gradient.{axis} = slopes.gradient.{axis} + {disc};"
            else:
                yield f"slopes.add({disc}, gradient{self.fields.index(leaf.name)});"
        yield "return slopes;"

    def _away(self) -> Iterator[str]:
        """The distances of a place."""
        yield "double3 found = 0.0lf;"
        if self.is_bounded and self.targets:
            yield f"[loop] for (uint k = 0u; k < {len(self.targets)}u; ++k) found[k] = nearest(k, position).distance;"
        yield "return found;"

    @property
    def _parts(self) -> Mapping[Node, Node]:
        """The expression's derivatives in its leaves, where they aren't nought."""
        root = self.expression.root
        varying = [leaf for leaf in leaves(root) if not (leaf.op == "attribute" and is_constant(leaf.name))]
        parts = {leaf: partial(root, leaf) for leaf in varying}
        return {leaf: part for leaf, part in parts.items() if part is not ZERO}

    def _gradient(self) -> Iterator[str]:
        """The chain rule over the leaves; by differences where their own gradients aren't at hand."""
        root = self.expression.root
        varying = [leaf for leaf in leaves(root) if not (leaf.op == "attribute" and is_constant(leaf.name))]
        if any(
            (leaf.op == "attribute" and not is_distance(leaf)) or len(leaf.axes) > (leaf.op == "coordinate")
            for leaf in varying
        ):
            yield "return differences<V, Given>(element, r);"
            return
        parts = self._parts
        used = leaves(*parts.values())
        yield from self._frame(used, list(parts))
        yield from self._ingredients(used, list(parts))
        names = yield from self._statements(self._numbers, *parts.values())
        terms = [f"{names[part]} * {self._gradient_of(leaf)}" for leaf, part in parts.items()]
        yield f"return {' + '.join(terms) or 'double3(0.0lf, 0.0lf, 0.0lf)'};"

    def _frame(self, used: Sequence[Node], varying: Sequence[Node]) -> Iterator[str]:
        """The frame at a point if ingredients of the leaves use it."""
        if self._has_frame(used, varying):
            yield "Frame frame = V(element).frame(r);"

    @staticmethod
    def _has_frame(used: Sequence[Node], varying: Sequence[Node]) -> bool:
        """Whether ingredients of the leaves use the frame."""
        placed = any(leaf.op == "coordinate" or target_of(leaf.name) is not None for leaf in (*used, *varying))
        framed = placed or any(leaf.axes for leaf in used)
        return framed or any(leaf.op == "attribute" and not is_constant(leaf.name) for leaf in used)

    def _ingredients(self, used: Sequence[Node], varying: Sequence[Node]) -> Iterator[str]:
        """Ingredients of the leaves with a known frame: values and gradients of fields (also in the world)."""
        if any(target_of(leaf.name) is not None for leaf in (*used, *varying)):
            count = len(self.targets)
            yield f"Near nears[{count}];"
            yield f"[loop] for (uint k = 0u; k < {count}u; ++k) nears[k] = nearest(k, frame.position);"
        if any(leaf.op == "attribute" and leaf.name in SIDES for leaf in used):
            rows = ", ".join(f"double4({', '.join(f'{x!r}lf' for x in row)})" for row in self.facets.tolist())
            yield f"static const double4 facets[{len(self.facets)}] = {{ {rows} }};"
            yield f"double3 inward = side_gradient<{len(self.facets)}>(frame, facets, about);"
        valued = [leaf.name for leaf in used if leaf.op == "field" and not leaf.axes]
        derived = [leaf.name for leaf in used if leaf.op == "field" and len(leaf.axes) == 1]
        varied = [leaf.name for leaf in varying if leaf.op == "field"]
        yield from self._gather("value", "double", "value(r)", valued)
        yield from self._gather("reference_gradient", "double3", "gradient(r)", [*derived, *varied])
        for m in self._rows(derived):
            yield f"double3 gradient{m} = in_world(frame, reference_gradient{m});"
        for m in self._rows([leaf.name for leaf in used if len(leaf.axes) > 1]):
            row = f"element * {len(self.fields)}u + {m}u"
            yield f"Hessian hessian{m} = Hessian(V({row}), V(element), r);"

    def _gather(self, name: str, type: str, asked: str, fields: Sequence[str]) -> Iterator[str]:
        """Requested data of fields, in one loop: drivers compile many copies of an element's code slowly."""
        rows = self._rows(fields)
        if len(rows) > 1:
            numbers = f"static const uint {name}_rows[{len(rows)}] = {{ {', '.join(map(str, rows))} }};"
            yield f"{numbers} {type} {name}s[{len(rows)}];"
            row = f"element * {len(self.fields)}u + {name}_rows[k]"
            yield f"[loop] for (int k = 0; k < {len(rows)}; ++k) {name}s[k] = V({row}).{asked};"
        for k, m in enumerate(rows):
            one = f"V(element * {len(self.fields)}u + {m}u).{asked}"
            yield f"{type} {name}{m} = {f'{name}s[{k}]' if len(rows) > 1 else one};"

    def _rows(self, fields: Sequence[str]) -> list[int]:
        return sorted({self.fields.index(name) for name in fields})

    def _gradient_of(self, leaf: Node) -> str:
        """The gradient of a leaf in reference coordinates."""
        if leaf.op == "coordinate":
            axis = "xyz"[leaf.axes[0]]
            return f"double3(frame.dx.{axis}, frame.dy.{axis}, frame.dz.{axis})"
        if leaf.op == "attribute":
            return f"in_reference(frame, nears[{self.targets.index(str(target_of(leaf.name)))}].gradient)"
        return f"reference_gradient{self.fields.index(leaf.name)}"

    @property
    def _numbers(self) -> _Kind:
        return _Kind("double", str, self._leaf)

    @property
    def _discs(self) -> _Kind:
        return _Kind("Disc", "Disc({})".format, self._disc)

    def _statements(self, kind: _Kind, *roots: Node) -> Generator[str, None, Mapping[Node, str]]:
        """One statement per part of the expressions, after the statements of its operands; returns the parts' names."""
        names: dict[Node, str] = {}
        for number, node in enumerate(ordered(*roots)):
            if node.op == "number":
                names[node] = kind.exact(_literal(node.value))
                continue
            names[node] = f"v{number}"
            operands = [names[operand] for operand in node.operands]
            text = kind.leaf(node) if node.op in LEAVES else _operation(node, operands)
            yield f"{kind.type} {names[node]} = {text};"
        return names

    def _disc(self, node: Node) -> str:
        """A leaf's disc."""
        if node.op == "coordinate":
            return f"leaves.coordinate({node.axes[0]})"
        target = target_of(node.name)
        if target is not None:
            number = self.targets.index(target)
            return f"leaves.distance({number}, surface_facts[{2 * number}])"
        if node.op == "attribute":
            return f"Disc({self._constant(node.name, 'leaves.element')})"
        m = self.fields.index(node.name)
        return f"gradient{m}.{'xyz'[node.axes[0]]}" if node.axes else f"leaves.field({m})"

    def _leaf(self, node: Node) -> str:
        """A leaf's value."""
        if node.op == "coordinate":
            return f"frame.position.{'xyz'[node.axes[0]]}"
        if node.op == "attribute":
            return self._attribute(node.name)
        m, along = self.fields.index(node.name), "".join(f".{'xyz'[axis]}" for axis in node.axes)
        return f"{('value', 'gradient', 'hessian')[len(node.axes)]}{m}{along}"

    def _attribute(self, name: str) -> str:
        target, direction = target_of(name), direction_of(name)
        if target is not None:
            near = f"nears[{self.targets.index(target)}]"
            if direction is None:
                return f"{near}.distance"
            return f"{near}.{'away' if direction.is_away else 'gradient'}.{'xyz'[direction.axis]}"
        if is_constant(name):
            return self._constant(name, "element")
        if name == "quality":
            columns = (f"double3({', '.join(f'{x!r}lf' for x in column)})" for column in self.ideal.T.tolist())
            return f"quality(frame, {', '.join(columns)}, {self.dimension})"
        if name in SIDES:
            length = "sqrt(dot(inward, inward))"
            return f"1.0lf / {length}" if name == "face_height" else f"-inward.{name[1]} / {length}"
        if name in DUALS:
            ones = ", ".join("1.0lf" if name[2] == str(i) else "0.0lf" for i in (1, 2, 3))
            return f"in_world(frame, double3({ones})).{name[-1]}"
        return "frame.determinant()" if name == "jacobian" else "scaled_jacobian(frame)"

    def _constant(self, name: str, element: str) -> str:
        """One of an element's numbers."""
        names = self.constants
        return f"element_constants[{element} * {len(names)}u + {names.index(name)}u]"


def is_distance(leaf: Node) -> bool:
    """Whether a leaf is the distance to a surface."""
    return leaf.op == "attribute" and target_of(leaf.name) is not None and direction_of(leaf.name) is None


def is_continuous(root: Node, is_finite: bool) -> bool:
    """Whether an expression has neither jumps nor poles: whatever its leaves are, or given that it is finite."""
    return all(_is_continuous(node, is_finite) for node in ordered(root))


def _is_continuous(node: Node, is_finite: bool) -> bool:
    """The same of a part of an expression, whatever its operands are."""
    if node.op in LEAVES or node.op in _CONTINUOUS or (is_finite and node.op in _WHERE_FINITE):
        return True
    if node.op == "/":
        return node.operands[1].op == "number" and node.operands[1].value != 0
    exponent = whole_exponent(node)
    return exponent is not None and 0 <= exponent <= _MOST_FACTORS


def _operation(node: Node, operands: Sequence[str]) -> str:
    """An operator or function of the texts of its operands."""
    exponent = whole_exponent(node)
    if exponent is not None and abs(exponent) <= _MOST_FACTORS:
        return f"whole_power({operands[0]}, {exponent})"
    if node.op in "+-*":
        return f"{operands[0]} {node.op} {operands[1]}"
    return f"{_FUNCTIONS[node.op]}({', '.join(operands)})"


def ideal_of(shape: Shape | None) -> Floats:
    """(3, 3) the matrix to the ideal element as `Formula` takes it, unchanged beyond the shape's dimension."""
    matrix = np.eye(3)
    if shape is not None:
        matrix[: shape.dimension, : shape.dimension] = from_ideal(shape)
    return matrix


def facets_of(shape: Shape | None, unit: bool = False) -> Floats:
    """(k, 4) the facets of a shape as `Formula` takes them; ``unit`` where its coordinates are from 0 to 1."""
    if shape is None:
        return np.zeros((0, 4))
    normals, offsets = facets(shape)
    if unit:
        normals, offsets = 2 * normals, offsets - normals.sum(axis=1)
    found = np.zeros((len(normals), 4))
    found[:, : shape.dimension], found[:, 3] = normals, offsets
    return found


def _literal(value: float) -> str:
    """A number in Slang."""
    if np.isfinite(value):
        return f"{value!r}lf" if value >= 0 else f"({value!r}lf)"
    if np.isnan(value):
        return "not_a_number()"
    return "infinity()" if value > 0 else "(-infinity())"
