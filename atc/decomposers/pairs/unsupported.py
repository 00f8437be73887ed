"""LAMMPS pair styles that are known and not supported, with the reason: what a user is told instead of a list of
names."""

from __future__ import annotations

from ..bonded.unsupported import REASONS as BONDED

_KSPACE = (
    "its long-range part is not done yet: lj/cut/coul/long and its relatives are supported, with kspace_style ewald "
    "or pppm"
)
_SITE = "softened charges on a virtual site are not done yet: lj/cut/tip4p/long and tip4p/long are"
_ANGLES = "it depends on the orientation of the particles, which is no function of the distances between atoms"
_MANY_BODY = "it is a many-body potential that is not done yet"
_DENSITY = "its forces depend on local densities of many atoms, which is not done yet"
_MACHINE = (
    "it is a machine-learned potential that atc has no LAMMPS reader for; see atc.nep, atc.mace, atc.nequip, "
    "atc.metatomic and atc.edge_model"
)
_CHARGES = "it finds its charges as the run goes (charge equilibration), which positions alone do not give"
_SIZES = "it needs the diameters of the atoms, which frames do not carry"
_CONTACT = "its forces depend on diameters, spins and the history of contacts, not on positions alone"
_HISTORY = "its forces depend on the bonds of a reference state and on their history; for peridynamics see atc pd"
_PARTICLES = (
    "its forces depend on densities, energies and other fields that each particle carries along, not on positions alone"
)
_VELOCITY = "its forces depend on velocities or random numbers, not on positions alone"
_REACTING = "its particles carry temperatures, energies or concentrations of their own, not positions alone"
_LAYERS = "it depends on the normals of atomic layers or on one direction in space and not on distances alone"
_MOLECULES = "it acts between different molecules (or within one), whose numbers frames do not carry"
_MULTIPOLES = "its atoms carry multipoles and induced dipoles, which positions alone do not give"
_DRUDE = "it acts on parts of the charges of Drude pairs that 'fix drude' names, which the potential's lines do not say"
_DIELECTRIC = "each atom has a dielectric constant and an area of its own, which frames do not carry"
_ELECTRONS = "its particles are electrons with radii of their own"
_SPINS = (
    "its forces depend on the angles between the spins and the line from atom to atom, so that they are not along it"
)
_SEGMENTS = "it acts between segments of tubes or bonds instead of between atoms"
_LATER = "it is not done yet, though it is a function of one distance"

_PAIR = {
    _KSPACE: (
        "born/coul/long/cs born/coul/msm buck/coul/long/cs buck/coul/msm buck/long/coul/long buck6d/coul/gauss/long "
        "coul/long/cs coul/long/soft coul/msm coul/slater/long dpd/coul/slater/long lj/charmm/coul/long/soft "
        "lj/charmm/coul/msm lj/class2/coul/long/cs lj/class2/coul/long/soft lj/cut/coul/long/cs lj/cut/coul/long/soft "
        "lj/cut/coul/msm lj/expand/coul/long lj/sdk/coul/long lj/sdk/coul/msm lj/spica/coul/long lj/spica/coul/msm "
        "lj/switch3/coulgauss/long mm3/switch3/coulgauss/long"
    ),
    _SITE: "lj/cut/tip4p/long/soft tip4p/long/soft",
    _ANGLES: (
        "body/nparticle body/rounded/polygon body/rounded/polyhedron gayberne line/lj lj/cut/dipole/cut "
        "lj/cut/dipole/long lj/long/dipole/long lj/sf/dipole/sf oxdna/coaxstk oxdna/excv oxdna/hbond oxdna/stk "
        "oxdna/xstk oxdna2/coaxstk oxdna2/dh oxdna2/excv oxdna2/hbond oxdna2/stk oxdna2/xstk oxrna2/coaxstk oxrna2/dh "
        "oxrna2/excv oxrna2/hbond oxrna2/stk oxrna2/xstk resquared tri/lj ylz"
    ),
    _MANY_BODY: (
        "adp agni airebo airebo/morse bop dispersion/d3 e3b eam/cd eam/cd/old eam/he edip edip/multi eim extep gw "
        "gw/zbl hbond/dreiding/lj hbond/dreiding/lj/angleoffset hbond/dreiding/morse hbond/dreiding/morse/angleoffset "
        "lcbop meam meam/c meam/ms meam/spline meam/sw/spline mgpt nb3b/harmonic nb3b/screened polymorphic rebo "
        "rebomos sw/angle/table sw/mod tersoff/mod tersoff/mod/c tersoff/table tersoff/zbl threebody/table vashishta "
        "vashishta/table"
    ),
    _DENSITY: "local/density mdpd mdpd/rhosum multi/lucy",
    _MACHINE: "mliap pod uf3 pace pace/extrapolation quip hdnnp rann nequip allegro mace deepmd metatomic",
    _CHARGES: "comb comb3 coul/ctip coul/streitz reax reax/c reaxff smtbq",
    _SIZES: "lepton/sphere lj/cut/sphere lj/expand/sphere yukawa/colloid",
    _CONTACT: "gran/hertz/history gran/hooke gran/hooke/history granular",
    _HISTORY: "bpm/spring peri/eps peri/lps peri/pmb peri/ves",
    _PARTICLES: (
        "rheo rheo/solid sdpd/taitwater/isothermal smd/hertz smd/tlsph smd/tri_surface smd/ulsph sph/heatconduction "
        "sph/idealgas sph/lj sph/rhosum sph/taitwater sph/taitwater/morris"
    ),
    _VELOCITY: "brownian brownian/poly dsmc lubricate lubricate/poly lubricateU lubricateU/poly",
    _REACTING: "edpd exp6/rx multi/lucy/rx table/rx tdpd",
    _LAYERS: "aip/water/2dm drip ilp/graphene/hbn ilp/tmd kolmogorov/crespi/full kolmogorov/crespi/z lebedeva/z "
    "saip/metal",
    _MOLECULES: "coul/shield hybrid/molecular",
    _MULTIPOLES: "amoeba hippo",
    _DRUDE: "coul/tt lj/cut/thole/long thole",
    _DIELECTRIC: (
        "coul/cut/dielectric coul/long/dielectric lj/cut/coul/cut/dielectric lj/cut/coul/debye/dielectric "
        "lj/cut/coul/long/dielectric lj/cut/coul/msm/dielectric lj/long/coul/long/dielectric"
    ),
    _ELECTRONS: "awpmd/cut",
    _SPINS: "spin/dipole/cut spin/dipole/long spin/dmi spin/magelec spin/neel",
    _SEGMENTS: "mesocnt mesocnt/viscous mesont/tpm srp srp/react",
    _LATER: "buck6d/coul/gauss/dsf nm/cut/split",
    "it is a model that another program or library computes": "kim python",
}

REASONS: dict[str, dict[str, str]] = {
    "pair": {name: why for why, names in _PAIR.items() for name in names.split()},
    **BONDED,
}


def reason(kind: str, name: str) -> str | None:
    """Why a LAMMPS style is not supported, if it is one that is known."""
    return REASONS.get(kind, {}).get(name)
