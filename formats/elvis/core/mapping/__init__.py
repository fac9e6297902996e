"""From reference to world and back: entities and their turns, the blend of curves, inverse maps, point location."""
