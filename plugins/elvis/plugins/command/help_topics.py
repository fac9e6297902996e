"""``elvis help``: pages on what several commands share, and the help of single commands."""

from __future__ import annotations

from collections.abc import Callable

import click

GEOMETRY = """Geometry in options of elvis commands

Points such as P and Q are X,Y,Z, or X,Y in 2D.  C is a centre, A an axis and N
a normal, both of any length; a final :N in seeds is a number of points.

Surfaces (--cut, --clip, integrate --over, extract):
  plane:P:N                     plane through P; its inside is behind the normal
  z=V                           plane at a coordinate, also x=V and y=V
  middle:z, plane:z or z        plane across an axis through the middle of the
                                data, also in sections and seeds
  sphere:C:RADIUS               sphere
  cylinder:P:A:RADIUS           infinite cylinder around the axis through P
  cone:APEX:A:DEGREES           cone with its half-angle (drawing commands)
  mesh:FILE                     triangles of an STL, PLY, OBJ or GLB file (same)
  implicit:EXPRESSION           zero set, negative inside (same)
  QUANTITY=VALUE                isosurface, lower values inside (integrate,
                                extract, probe)
  outside:SURFACE               for --clip: exclude the outside, not the inside

Curves (probe --along, integrate --over):
  line:P:Q                      straight line
  polyline:P:Q:R                straight lines through two or more points
  spline:P:Q:R                  natural cubic spline through the points
  circle:C:N:RADIUS             full circle around C, perpendicular to N
  normal:BOUNDARY:P:LENGTH      normal of a boundary, from its point nearest to
                                P towards P, or into the data
  boundary:NAME                 boundary of 2D data (not for integrate)
  section:BOUNDARY:plane:P:N    cut of a boundary of 3D data with a plane

Seeds and points (--streamlines, --glyphs, trace --seeds):
  point:P                       one point
  line:P:Q:N                    N points from P to Q, ends included
  polyline:P:Q:R:N, spline:..., N points at equal distances along such a curve
  circle:..., normal:..., section:...
  disc:C:NORMAL:RADIUS:N        N points spread evenly over a disc
  grid:LOW:HIGH:NX,NY,NZ        lattice over a box, ends included
  plane:P:NORMAL:N              square lattice on a plane, N points along the
                                longest side of the box
  elements                      middle of each element
  boundary:NAME:N               N points each way on each face; in 2D, N points
                                on each edge
  N, random:N                   N random points in the elements
  random:N:LOW:HIGH             N random points in the elements within a box
  FILE                          table of points with columns x, y, z
"""
#: pages by name, with one line about each
TOPICS = {"geometry": (GEOMETRY, "Surfaces, curves and seeds in options.")}


def help_command(command_of: Callable[[str], click.Command | None]) -> click.Command:
    """The command ``help``.

    command_of  finds the command of a name, None for unknown names
    """

    @click.command("help")
    @click.argument("topic", required=False, metavar="[TOPIC|COMMAND]")
    @click.pass_context
    def show(context: click.Context, topic: str | None) -> None:
        """Show the page on a topic, or the help of a command.  Topics: geometry."""
        parent = context.parent or context
        if topic is None:
            click.echo(parent.get_help())
            return
        if topic in TOPICS:
            click.echo(TOPICS[topic][0], nl=False)
            return
        command = command_of(topic)
        if command is None:
            raise click.UsageError(f"no topic or command {topic!r}: expected {', '.join(TOPICS)} or a command", context)
        with click.Context(command, parent=parent, info_name=topic) as own:
            click.echo(command.get_help(own))

    return show
