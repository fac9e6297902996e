"""The predefined quantities of flows: one table, the source of hints, ``elvis info --quantities`` and the docs.

A formula is an expression as users write them.  In it u, v, w are the velocity, rho the density, p the pressure and T
the temperature, for any names in the data and any way to compute them (`flows`); ux is d(u,x), and so on; STEPS defines
further names, and PARAMETERS the numbers that belong to the flow as a whole.  In a plane, w is zero, and so are
derivatives along z.  If there are several formulas, the first that the data suffice for is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """A number that formulas need in addition to the fields.

    keys     lower-case keys of metadata that give it
    default  its value if not given elsewhere; None: it must be given
    """

    meaning: str
    keys: tuple[str, ...]
    default: float | None = None


@dataclass(frozen=True)
class PredefinedQuantity:
    """A quantity.

    formulas    in the language of expressions
    dimensions  of the flows that have it
    """

    name: str
    meaning: str
    formulas: tuple[str, ...]
    source: str = ""
    dimensions: tuple[int, ...] = (1, 2, 3)


PARAMETERS: Mapping[str, Parameter] = {
    "gamma": Parameter("ratio of specific heats", ("gamma",), 1.4),
    "R": Parameter("specific gas constant", ("gasconstant", "gas_constant")),
    "mu": Parameter("dynamic viscosity", ("mu", "dynamicviscosity", "dynamic_viscosity")),
    "nu": Parameter("kinematic viscosity", ("nu", "kinvis", "kinematicviscosity", "kinematic_viscosity")),
    "density": Parameter("density of an incompressible flow", (), 1.0),
    "p_ref": Parameter("reference pressure", ("p_ref", "pinf", "p_inf")),
    "rho_ref": Parameter("reference density", ("rho_ref", "rhoinf", "rho_inf")),
    "u_ref": Parameter("reference speed", ("u_ref",)),
    "dt": Parameter("time step", ("dt", "timestep", "time_step")),
    "Pr": Parameter("Prandtl number", ("pr", "prandtl", "prandtlnumber", "prandtl_number"), 0.72),
    "conductivity": Parameter("thermal conductivity", ("conductivity", "thermalconductivity", "thermal_conductivity")),
    **{f"{axis}_ref": Parameter(f"{axis} of the reference point of moments", (), 0.0) for axis in "xyz"},
}

#: quantities used by several formulas
STEPS: Mapping[str, tuple[str, ...]] = {
    "u": ("rhou/rho",),
    "v": ("rhov/rho",),
    "w": ("rhow/rho",),
    "p": ("(gamma - 1)*(E - 0.5*(rhou*rhou + rhov*rhov + rhow*rhow)/rho)",),
    "T": ("p/(rho*R)",),
    **{f"{name}{axis}": (f"d({name},{axis})",) for name in "uvwT" for axis in "xyz"},
    "speed2": ("u*u + v*v + w*w",),
    "gradient2": ("ux*ux + uy*vx + uz*wx + vx*uy + vy*vy + vz*wy + wx*uz + wy*vz + wz*wz",),
    "third": ("divergence/3",),
    "ex": ("ux - third",),
    "ey": ("vy - third",),
    "ez": ("wz - third",),
    "mach2": ("speed2*rho/(gamma*p)",),
    "heating": ("1 + 0.5*(gamma - 1)*mach2",),
    "mass": ("rho", "density"),
    "viscosity": ("mu", "nu*mass"),
    "conduction": ("conductivity", "viscosity*gamma*R/((gamma - 1)*Pr)"),
    "dynamic_pressure": ("0.5*reference_mass*u_ref^2",),
    "reference_mass": ("rho_ref", "density"),
    **{f"rate{i}": (f"abs(u*xi{i}_x + v*xi{i}_y + w*xi{i}_z)",) for i in (1, 2, 3)},
    "traction_x": ("-2*viscosity*(strain_xx*nx + strain_xy*ny + strain_xz*nz)",),
    "traction_y": ("-2*viscosity*(strain_xy*nx + strain_yy*ny + strain_yz*nz)",),
    "traction_z": ("-2*viscosity*(strain_xz*nx + strain_yz*ny + strain_zz*nz)",),
    "viscous_x": ("-2*viscosity*(ex*nx + strain_xy*ny + strain_xz*nz)",),
    "viscous_y": ("-2*viscosity*(strain_xy*nx + ey*ny + strain_yz*nz)",),
    "viscous_z": ("-2*viscosity*(strain_xz*nx + strain_yz*ny + ez*nz)",),
    "mean_shear": (
        "sqrt(shear_x*shear_x + shear_y*shear_y + shear_z*shear_z)",
        "sqrt(shear_x*shear_x + shear_y*shear_y)",
    ),
    # s . grad(s) . s/|s|^2 and div(s) along the wall, for the mean shear s
    "shear_stretch": (
        "(shear_x*shear_x*d(shear_x,x) + shear_y*shear_y*d(shear_y,y) + shear_z*shear_z*d(shear_z,z)"
        " + shear_x*shear_y*(d(shear_x,y) + d(shear_y,x)) + shear_y*shear_z*(d(shear_y,z) + d(shear_z,y))"
        " + shear_z*shear_x*(d(shear_z,x) + d(shear_x,z)))/mean_shear^2",
        "(shear_x*shear_x*d(shear_x,x) + shear_y*shear_y*d(shear_y,y) + shear_x*shear_y*(d(shear_x,y) + d(shear_y,x)))"
        "/mean_shear^2",
    ),
    "shear_divergence": (
        "d(shear_x,x) + d(shear_y,y) + d(shear_z,z)",
        "d(shear_x,x) + d(shear_y,y)",
    ),
    "traction": ("traction_x*nx + traction_y*ny + traction_z*nz",),
}

#: (S^2 + Omega^2)_ij = (sum_k a_ik a_kj + a_jk a_ki) / 2 with a = grad u, S and Omega its symmetric and its other part
_LAMBDA2 = (
    "middle_eigenvalue(ux*ux + uy*vx + uz*wx, uy*vx + vy*vy + vz*wy, uz*wx + vz*wy + wz*wz, "
    "0.5*(ux*uy + uy*vy + uz*wy + vx*ux + vy*vx + vz*wx), "
    "0.5*(ux*uz + uy*vz + uz*wz + wx*ux + wy*vx + wz*wx), "
    "0.5*(vx*uz + vy*vz + vz*wz + wx*uy + wy*vy + wz*wy))"
)
#: determinant of the gradient without its mean diagonal entry: the cubic is t^3 + q_deviatoric t - det
_SWIRL = "imaginary_root(q_deviatoric, ex*(vz*wy - ey*ez) + uy*(vx*ez - vz*wx) + uz*(ey*wx - vx*wy))"
_PLANE, _SOLID = (2, 3), (3,)
_HUNT = "Hunt, Wray and Moin 1988, Eddies, streams, and convergence zones in turbulent flows"
_CHONG = "Chong, Perry and Cantwell 1990, A general classification of three-dimensional flow fields"
_JEONG = "Jeong and Hussain 1995, On the identification of a vortex"
_ZHOU = "Zhou, Adrian, Balachandar and Kendall 1999, Mechanisms for generating coherent packets of hairpin vortices"
_LEVY = "Levy, Degani and Seginer 1990, Graphical visualization of vortical flows by means of helicity"
_LIEPMANN = "Liepmann and Roshko 1957, Elements of gasdynamics"
_KARNIADAKIS = "Karniadakis and Sherwin, Spectral/hp element methods for CFD, section 6.3"
_SCHLICHTING = "Schlichting 1979, Boundary-layer theory"
_FORCE = "component of the force of the flow on a wall, per area; only of the pressure if no viscosity is known"
_FRICTION = "component of the viscous force on a wall, per area, -2 mu (S - div(u)/3) n"
_MOMENT = "component of the moment of the force, per area"
_LEI = "Lei, Kleinstreuer and Truskey 1995, Numerical investigation and prediction of atherogenic sites"
_HIMBURG = "Himburg et al. 2004, Spatial comparison between wall shear stress measures and endothelial permeability"
_ON_WALLS = "tangential stress of a Newtonian fluid on a wall"


def _components(name: str, meaning: str, formula: str, source: str = "", *others: str) -> list[PredefinedQuantity]:
    """The components of a vector.

    @ represents the axis in its formulas; the z component exists only in three dimensions.
    """
    found = []
    for index, axis in enumerate("xyz"):
        formulas = tuple(text.replace("@", axis) for text in (formula, *others))
        found.append(PredefinedQuantity(f"{name}_{axis}", meaning, formulas, source, (1, 2, 3)[index:]))
    return found


QUANTITIES: tuple[PredefinedQuantity, ...] = (
    PredefinedQuantity("speed", "magnitude of the velocity", ("sqrt(u*u + v*v + w*w)",)),
    PredefinedQuantity("velocity_x", "component of the velocity", ("u",)),
    PredefinedQuantity("velocity_y", "component of the velocity", ("v",), "", _PLANE),
    PredefinedQuantity("velocity_z", "component of the velocity", ("w",), "", _SOLID),
    PredefinedQuantity("divergence", "divergence of the velocity", ("ux + vy + wz",)),
    PredefinedQuantity("vorticity", "curl of the velocity: its only component in a plane", ("vorticity_z",), "", (2,)),
    PredefinedQuantity(
        "vorticity",
        "magnitude of the curl of the velocity",
        ("sqrt(vorticity_x*vorticity_x + vorticity_y*vorticity_y + vorticity_z*vorticity_z)",),
        "",
        _SOLID,
    ),
    PredefinedQuantity("vorticity_x", "component of the curl of the velocity", ("wy - vz",), "", _SOLID),
    PredefinedQuantity("vorticity_y", "component of the curl of the velocity", ("uz - wx",), "", _SOLID),
    PredefinedQuantity("vorticity_z", "component of the curl of the velocity", ("vx - uy",), "", _PLANE),
    PredefinedQuantity("helicity", "u . rot u", ("u*vorticity_x + v*vorticity_y + w*vorticity_z",), "", _SOLID),
    PredefinedQuantity(
        "normalised_helicity",
        "cosine of the angle between velocity and vorticity: -1 to 1, NaN where either is zero",
        ("helicity/(speed*vorticity)",),
        _LEVY,
        _SOLID,
    ),
    PredefinedQuantity(
        "strain_rate",
        "magnitude sqrt(2 S : S) of the strain rate S = (grad u + grad u^T)/2",
        (
            "sqrt(2*(strain_xx*strain_xx + strain_yy*strain_yy + strain_zz*strain_zz)"
            " + 4*(strain_xy*strain_xy + strain_xz*strain_xz + strain_yz*strain_yz))",
        ),
    ),
    PredefinedQuantity("strain_xx", "component of the strain rate S", ("ux",)),
    PredefinedQuantity("strain_yy", "component of the strain rate S", ("vy",), "", _PLANE),
    PredefinedQuantity("strain_zz", "component of the strain rate S", ("wz",), "", _SOLID),
    PredefinedQuantity("strain_xy", "component of the strain rate S", ("0.5*(uy + vx)",), "", _PLANE),
    PredefinedQuantity("strain_xz", "component of the strain rate S", ("0.5*(uz + wx)",), "", _SOLID),
    PredefinedQuantity("strain_yz", "component of the strain rate S", ("0.5*(vz + wy)",), "", _SOLID),
    PredefinedQuantity("q_criterion", "(|Omega|^2 - |S|^2)/2 = -tr((grad u)^2)/2", ("-0.5*gradient2",), _HUNT),
    PredefinedQuantity(
        "q_invariant",
        "second invariant of grad u; equal to q_criterion if the flow has no divergence",
        ("0.5*(divergence*divergence - gradient2)",),
        _CHONG,
    ),
    PredefinedQuantity(
        "q_deviatoric",
        "second invariant of the deviatoric gradient, grad u - (div u)/3: Q of compressible flows",
        ("0.5*(divergence*third - gradient2)",),
        "Kolar 2009, Compressibility effect in vortex identification",
    ),
    PredefinedQuantity(
        "r_invariant",
        "third invariant of grad u: minus its determinant",
        ("ux*(vz*wy - vy*wz) + uy*(vx*wz - vz*wx) + uz*(vy*wx - vx*wy)",),
        _CHONG,
        _SOLID,
    ),
    PredefinedQuantity(
        "lambda2", "middle eigenvalue of S^2 + Omega^2: negative in vortices", (_LAMBDA2,), _JEONG, _PLANE
    ),
    PredefinedQuantity(
        "swirl",
        "swirling strength: imaginary part of the complex eigenvalues of grad u, 0 if all are real",
        (_SWIRL,),
        _ZHOU,
        _PLANE,
    ),
    PredefinedQuantity("pressure", "pressure, computed from the total energy if it is not a field", ("p",), _LIEPMANN),
    PredefinedQuantity(
        "temperature",
        "temperature, computed from pressure and density by the equation of state if it is not a field",
        ("T",),
        _LIEPMANN,
    ),
    PredefinedQuantity(
        "mach", "Mach number: speed divided by the speed of sound", ("speed/sqrt(gamma*p/rho)",), _LIEPMANN
    ),
    PredefinedQuantity(
        "total_pressure",
        "pressure of the gas, or of the incompressible flow, brought to rest without losses",
        ("p*heating^(gamma/(gamma - 1))", "p + 0.5*density*speed2"),
        _LIEPMANN,
    ),
    PredefinedQuantity("total_temperature", "temperature of the gas brought to rest", ("T*heating",), _LIEPMANN),
    PredefinedQuantity(
        "entropy", "entropy divided by c_v, up to a constant: log(p/rho^gamma)", ("log(p/rho^gamma)",), _LIEPMANN
    ),
    PredefinedQuantity("schlieren", "magnitude of the gradient of the density", ("grad(rho)",)),
    PredefinedQuantity(
        "pressure_coefficient",
        "pressure minus that of the free stream, divided by its dynamic pressure",
        ("(p - p_ref)/dynamic_pressure",),
        _SCHLICHTING,
    ),
    PredefinedQuantity(
        "wall_shear",
        f"magnitude of the {_ON_WALLS}; on faces of elements, NaN elsewhere",
        ("sqrt(wall_shear_x*wall_shear_x + wall_shear_y*wall_shear_y + wall_shear_z*wall_shear_z)",),
        _SCHLICHTING,
        _PLANE,
    ),
    *_components("wall_shear", f"component of the {_ON_WALLS}", "traction_@ - traction*n@", _SCHLICHTING),
    PredefinedQuantity(
        "skin_friction",
        "wall shear divided by the dynamic pressure",
        ("wall_shear/dynamic_pressure",),
        _SCHLICHTING,
        _PLANE,
    ),
    *_components(
        "skin_friction",
        "component of the wall shear divided by the dynamic pressure",
        "wall_shear_@/dynamic_pressure",
        _SCHLICHTING,
    ),
    PredefinedQuantity(
        "u_tau",
        "friction velocity: root of the wall shear divided by the density",
        ("sqrt(wall_shear/mass)",),
        _SCHLICHTING,
        _PLANE,
    ),
    PredefinedQuantity(
        "OSI",
        "oscillatory shear index: 0 if the wall shear keeps its direction, 0.5 if its mean is zero",
        ("0.5*(1 - mean_shear/TAWSS)",),
        _HIMBURG,
    ),
    PredefinedQuantity(
        "RRT",
        "relative residence time: 1/((1 - 2 OSI) TAWSS), the inverse of the magnitude of the mean wall shear",
        ("1/mean_shear",),
        _HIMBURG,
    ),
    PredefinedQuantity(
        "WSSG",
        "wall shear stress gradient: root of the squares of the mean shear's growth along and across its own direction",
        ("sqrt(shear_stretch^2 + (shear_divergence - shear_stretch)^2)",),
        _LEI,
    ),
    PredefinedQuantity(
        "heat_flux",
        "heat flow out of the fluid through a face, per area, -k dT/dn; k = mu c_p/Pr unless the conductivity is known",
        ("-conduction*(Tx*nx + Ty*ny + Tz*nz)",),
        _SCHLICHTING,
    ),
    PredefinedQuantity(
        "flux", "outward velocity through a face; its integral is the volume flow rate", ("u*nx + v*ny + w*nz",)
    ),
    PredefinedQuantity("mass_flux", "outward mass flow through a face, per area", ("mass*flux",)),
    *_components("pressure_force", "component of the pressure force on a wall, per area", "p*n@"),
    *_components("viscous_force", _FRICTION, "viscous_@", _SCHLICHTING),
    *_components("force", _FORCE, "p*n@ + viscous_@", _SCHLICHTING, "p*n@"),
    PredefinedQuantity("moment_x", _MOMENT, ("(y - y_ref)*force_z - (z - z_ref)*force_y",), "", _SOLID),
    PredefinedQuantity("moment_y", _MOMENT, ("(z - z_ref)*force_x - (x - x_ref)*force_z",), "", _SOLID),
    PredefinedQuantity("moment_z", _MOMENT, ("(x - x_ref)*force_y - (y - y_ref)*force_x",), "", _PLANE),
    PredefinedQuantity(
        "cfl",
        "CFL number of explicit advection: 0.2 p^2 dt times the largest speed of a reference coordinate, order p",
        ("0.2*order*order*dt*max(rate1, max(rate2, rate3))",),
        _KARNIADAKIS,
    ),
    PredefinedQuantity(
        "y_plus",
        "height of the element at a wall, in wall units; divide by the order to estimate y+ of the first node",
        ("face_height*sqrt(mass*wall_shear)/viscosity",),
        _SCHLICHTING,
        _PLANE,
    ),
)
