"""What refers to a reference body: Piola's and Eshelby's stress, the peridynamic stresses."""

from __future__ import annotations

from .quantity import PIOLA_SIGN, STRESS_SIGN, Quantity

_NODAL = (
    "half of each bond to each end, by the volume of the node; volumes from the column volume of the frame, those of "
    "the undeformed body for a peridynamic one"
)


def _peridynamic() -> list[Quantity]:
    """The peridynamic stresses (formulas: Lehoucq & Silling 2008; W eq. 7), Cauchy's and the first Piola-Kirchhoff."""
    out = []
    for name, prefix, sign, what in (
        ("peridynamic_stress", "", STRESS_SIGN, "peridynamic stress"),
        ("peridynamic_piola_stress", "reference_", PIOLA_SIGN, "first Piola-Kirchhoff peridynamic stress"),
    ):
        common = {"dimension": "pressure", "rank": 2, "sign": sign}
        where = "grid points are points of the reference frame; " if prefix else ""
        bond = "piola" if prefix else "stress"
        form = (lambda s: s.bond["piola"].reshape(-1, 3, 3)) if prefix else (lambda s: s.potential_stress)
        out.append(
            Quantity(
                name,
                long_name=what,
                bond=(bond,),
                form=form,
                linear=not prefix,
                comment=where
                + "of Lehoucq and Silling, smoothed with the kernel: the potential part of Hardy's stress "
                "over all bonds; its divergence is the "
                "force density",
                **common,
            )
        )
        for variant, word in (("weighted", "weighted virial"), ("weighted_normalised", "normalised weighted virial")):
            source = prefix + variant
            out.append(
                Quantity(
                    name + "_" + variant.replace("weighted", "weighted_virial"),
                    long_name=f"{what}, {word}",
                    point=(source,),
                    form=lambda s, source=source: s.point[source].reshape(-1, 3, 3),
                    comment=where
                    + (
                        "bonds with both ends within the horizon of the point, each weighted with ½ |r| (e_i "
                        "- e_j), e from the point to the end"
                        + (", over its mean weight" if "normalised" in variant else "")
                        + ", by the volume of the horizon; no kernel"
                    ),
                    **common,
                )
            )
        moment = prefix + "atom_moment"
        out.append(
            Quantity(
                name + "_nodal_virial",
                long_name=f"{what}, nodal virial",
                kind="atom",
                whole=(moment, "atom_volume"),
                form=lambda s, moment=moment: s.whole[moment].reshape(-1, 3, 3) / s.whole["atom_volume"][:, None, None],
                comment=_NODAL,
                **common,
            )
        )
    return out


QUANTITIES = [
    Quantity(
        "piola_stress",
        "pressure",
        "potential part of the first Piola-Kirchhoff stress",
        lambda s: s.bond["piola"].reshape(-1, 3, 3),
        rank=2,
        bond=("piola",),
        sign=PIOLA_SIGN,
        comment="grid points are points of the reference frame; the bond function runs between reference positions; "
        "no kinetic part",
    ),
    Quantity(
        "eshelby_stress",
        "pressure",
        "Eshelby's energy-momentum stress",
        lambda s: s.eshelby,
        rank=2,
        bond=("piola",),
        gradient=True,
        gather=("reference_mass", "reference_displacement", "reference_energy"),
        sign="W I - P (Grad u)^T; component [i, j]: i the reference direction of the divergence (face normal), j the "
        "component of the configurational force",
        comment="grid points are points of the reference frame, and all sums run over reference positions: W the "
        "potential energy density relative to the "
        "reference frame, P piola_stress, u the mass-weighted displacement; no kinetic or entropic part; NaN where "
        "there is no mass",
    ),
    *_peridynamic(),
]
