"""Long-range Coulomb: Ewald's split into bonds inside a cutoff and a smooth part that is given by its modes.

With ρ(k) = Σ_j q_j e^{−ik·x_j} and V(k²) = (4πC/k²) e^{−s k²}, s = 1/4α², V(0) = 0, the smooth energy is (1/2V) Σ_k V
|ρ|² − (αC/√π) Σ q² and its stress, before smoothing,

    σ_µν(Q) = −(1/2V) Σ_{a+b=Q} ρ(a) ρ(b) K_µν,   K = ½(V_a + V_b) δ_µν + D (½Q² δ_µν − a_µ b_ν − b_µ a_ν),   D = (V_b −
    V_a)/(b² − a²)

whose divergence is the density of the smooth forces at every Q: Q_µ K_µν = V_a a_ν + V_b b_ν. Symmetric; for V = 4πC/k²
it is Maxwell's stress. Which part is bonds and which is smooth is the choice of α: fields depend on it by a part
without divergence and without integral.

split      α and the largest mode, from the accuracy and the cutoff
transform  sums over charges and their modes: by the spreading window and fast transforms, and (for tests and checks)
directly ewald      energy, forces, virials of the smooth part; the correction for slabs
stress     stress and energy current as products of fields
"""
