"""The finite element core, on which every format, plugin and picture is built; it depends on none of them.

mesh, dataset, geometry, patch   the data: vertices, elements, curves, fields
polynomials                      bases, expansions, quadrature, Bernstein bounds
mapping                          from reference coordinates to the world and back, point location
quantities                       expressions, derivatives, certified bounds
distances                        distances to curved boundaries and triangle meshes
validity                         proofs whether the map of an element folds
describing                       representation of these objects at a prompt and in a notebook
integrals                        over elements and boundaries, exact or with a stated error
wall_curves                      curves on boundaries: 2D walls, and sections of planes with 3D walls
critical_points, wall_points     all zeros of a velocity, and of the shear on a wall
cores                            all vortex cores
streamlines                      lines along a velocity
extrema, quantity_extrema        certified minimum and maximum of a field, and of any quantity
norms, sampling, queries         numbers computed from a dataset
moments                          steps and times of series
files, terminal, arguments       safe reading and writing of files, messages, options shared by commands
memory, errors                   limits, error classes
testing                          datasets generated for tests
"""
