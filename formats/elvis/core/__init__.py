"""The finite element core, on which every format, plugin and picture is built; it depends on none of them.

base          arrays, errors, memory, ranks, messages: what knows no finite element
shapes        the seven reference shapes
data          meshes, datasets, fields, moments of a series, arguments that mean data
polynomials   bases, expansions, quadrature, Bernstein bounds
mapping       from reference coordinates to the world and back, point location
interfaces    sides of elements that do not match
deformed      deformed, copied and separated geometry
quantities    expressions, derivatives, certified bounds
bounds        certified minimum and maximum of a field, and of any quantity
chebyshev_models  models of quantities on boxes
distances     distances to curved boundaries and triangle meshes
validity      proofs whether the map of an element folds
numbers       norms, samples, histograms, spectra, the quality of a mesh
integrals     over elements and boundaries, exact or with a stated error
differences   between two datasets
resolution    how well fields are resolved
triangles     surfaces as triangles, as exact as requested
wall_curves   curves on boundaries: 2D walls, and sections of planes with 3D walls
critical, cores  all zeros of a velocity, and of the shear on a wall; all vortex cores
streamlines   lines along a velocity
portions      parts of a dataset
summary       what is said of a dataset
files         safe reading and writing of files
testing       datasets generated for tests
"""
