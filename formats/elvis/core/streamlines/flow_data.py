"""Data for tracing lines: the elements of a dataset, or other data that can be evaluated in the same way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TypeAlias

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.locate import Locator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.streamlines.seeds import SeedPlaces
from elvis.core.streamlines.velocity import Velocity, components_in
from elvis.core.streamlines.walls import WallVelocity, check_walls, corners_of, shear_expressions


class FlowData(ABC):
    """Elements with fields.

    names      names for expressions
    dimension  of the elements
    space      number of coordinates of the space that contains them
    """

    names: Names
    dimension: int
    space: int

    def components(self, texts: Sequence[str] | None) -> list[Expression]:
        """The components of a velocity, given as texts or by the usual names; raises ElvisError without any."""
        return components_in(self.names, texts)

    @abstractmethod
    def velocity(self, expressions: Sequence[Expression], others: Sequence[Expression] = ()) -> Velocity:
        """A velocity with some components, which can also evaluate additional quantities."""

    @abstractmethod
    def neighbours(self, velocity: Velocity) -> Neighbours:
        """The elements beyond the sides of its elements."""

    @abstractmethod
    def locator(self, velocity: Velocity) -> Locator:
        """The locator of points in its elements."""

    @abstractmethod
    def seed_places(self, velocity: Velocity, locator: Locator) -> SeedPlaces:
        """The data to which texts of seeds refer."""

    @abstractmethod
    def on_wall(
        self, wall: str, texts: Sequence[str] | None, others: Sequence[Expression]
    ) -> tuple[Velocity, Neighbours]:
        """The shear on a boundary, or other components along it, and its faces; raises ElvisError if there is none."""


class DatasetFlow(FlowData):
    """The elements of a dataset."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset, self.names = dataset, Names.of(dataset)
        self.dimension, self.space = dataset.mesh.dimension, dataset.mesh.space

    def velocity(self, expressions: Sequence[Expression], others: Sequence[Expression] = ()) -> Velocity:
        """In the elements that have all its fields."""
        return Velocity(self.dataset, expressions, others)

    def neighbours(self, velocity: Velocity) -> Neighbours:
        """The neighbours in the mesh."""
        return Neighbours.of(self.dataset, velocity.patches)

    def locator(self, velocity: Velocity) -> Locator:
        """The locator by the inverse of the maps."""
        return Locator(velocity.patches)

    def seed_places(self, velocity: Velocity, locator: Locator) -> SeedPlaces:
        """With the mesh's boundaries."""
        return SeedPlaces.of(self.dataset, locator, velocity.evaluator.patches)

    def on_wall(
        self, wall: str, texts: Sequence[str] | None, others: Sequence[Expression]
    ) -> tuple[Velocity, Neighbours]:
        """In the faces' own coordinates."""
        check_walls(self.dataset, wall)
        velocity = WallVelocity(self.dataset, shear_expressions(self.dataset, texts), others, wall)
        vertices = [corners_of(self.dataset, piece) for piece in velocity.pieces]
        return velocity, Neighbours.of_faces(velocity.patches, vertices)


#: data in which lines are traced
FlowSource: TypeAlias = Dataset | FlowData


def flow_data(data: FlowSource) -> FlowData:
    """Wrap a dataset; other data are returned unchanged.  Raises ElvisError for 1D data."""
    found = DatasetFlow(data) if isinstance(data, Dataset) else data
    if found.dimension < 2:
        raise ElvisError("expected 2D or 3D data, found 1D data, in which lines have only one direction")
    return found
