"""The finite element core: what every format, plugin and picture is made of; it knows none of them.

mesh, dataset, geometry, patch   what there is: vertices, elements, curves, fields
polynomials                      bases, expansions, quadrature, Bernstein bounds
mapping                          from reference coordinates to the world and back, point location
quantities                       expressions, derivatives, certified bounds
distances                        distances to curved boundaries and triangle meshes
validity                         whether the map of an element folds, proved
describing                       what these show of themselves at a prompt and in a notebook
integrals                        over elements and boundaries, exact or with a stated error
wall_curves                      curves on boundaries: 2D walls, and where planes cut 3D walls
critical_points, wall_points     where a velocity is zero, and the shear on a wall, all places
cores                            the cores of vortices, all of them
streamlines                      lines along a velocity
extrema, quantity_extrema        the least and greatest value of a field, and of any quantity, certified
norms, sampling, queries         numbers that are asked of a dataset
moments                          steps and times of series
files, terminal, arguments       files that are read and written safely, messages, what commands have in common
memory, errors                   limits, what goes wrong
testing                          datasets made on the spot
"""
