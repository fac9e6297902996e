"""The audit: pixels whose truth is an analytic expression, over all shapes and odd places, and what counts them.

`polynomials` and `basis` make exact data, `worlds` meshes with explicit inverses, `truths` what rays meet, `validating`
counts.  Families yield cases without end, each from a seed of its own; `running` draws and counts them.
"""
