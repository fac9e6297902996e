"""Numbers that a device computes: values at points, integrals of runtime plugins."""
