"""Cell, boundaries and times that a person says because the files cannot."""

import numpy as np
import pytest
from test_readers_dump import simple, write_dump

import atc
from atc.config.scene import Scene
from atc.errors import AtcError, AtcWarning

IN = (
    "units metal\nboundary p p f\nread_data run.data\npair_style lj/cut 4.0\npair_coeff 1 1 0.0104 3.4\n"
    "timestep 0.002\nrun 10\n"
)


def lattice(k=4, a=4.0, jitter=0.0, seed=0):
    x = np.stack(np.meshgrid(*[np.arange(k) * a] * 3, indexing="ij"), -1).reshape(-1, 3)
    return x + np.random.default_rng(seed).uniform(-jitter, jitter, x.shape)


def write_xyz(path, frames, comment="Atoms. Timestep: {step}", name="Ar"):
    lines = []
    for k, x in enumerate(frames):
        lines += [str(len(x)), comment.format(step=10 * k), *(f"{name} {p[0]:.6f} {p[1]:.6f} {p[2]:.6f}" for p in x)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_cell_for_plain_xyz(tmp_path):
    path = write_xyz(tmp_path / "run.xyz", [lattice(jitter=0.3, seed=k) for k in range(3)])
    with pytest.raises(AtcError, match="give it as cell"):
        atc.read(path, units="metal")
    for given, origin in (([16.0, 16.0, 16.0], 0.0), (np.diag([16.0] * 3).tolist(), 0.0), ([[-2.0, 14.0]] * 3, -2.0)):
        traj = atc.read(path, units="metal", cell=given, pbc="ppf", timestep=0.002)
        f = traj[2]
        assert np.allclose(f.cell.vectors, 16.0 * np.eye(3)) and np.allclose(f.cell.origin, origin)
        assert f.cell.periodic.tolist() == [True, True, False]
        assert f.units.to_user("time", f.time) == pytest.approx(0.04)
        assert len(traj[1:]) == 2 and traj[1:][1].step == 20
    # the sums over images are those of the same atoms with a cell of their own
    pot = atc.potential("pair_style lj/cut 4.5\npair_coeff * * 0.0104 3.4", units="metal")
    args = (pot, atc.kernel("quartic", 5.0), atc.Grid.regular(shape=3), ["stress_potential"])
    plain = atc.fields(atc.read(path, units="metal", cell=[16.0] * 3), *args)
    own = [f.replace(cell=atc.Cell([16.0] * 3)) for f in traj]
    assert np.array_equal(plain.stress_potential, atc.fields(own, *args).stress_potential)


def test_a_crystal_in_xyz_is_not_silently_a_cluster(tmp_path):
    path = write_xyz(tmp_path / "crystal.xyz", [lattice(8)], comment="")
    with pytest.warns(AtcWarning, match=r"fill a box to its corners: if it was periodic, give its cell"):
        atc.read(path)[0]
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not atc.read(path, pbc="fff")[0].cell.periodic.any()
        assert atc.read(path, cell=[32.0] * 3)[0].cell.periodic.all()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"cell": [9.0, 9.0, 9.0]}, "leave cell out"),
        ({"pbc": "fff"}, "says itself which axes repeat, ppp"),
        ({"cell": [9.0, 9.0]}, "three lengths"),
        ({"cell": [9.0, 9.0, 0.0]}, "three lengths"),
        ({"pbc": "pq"}, "which of the axes repeat"),
        ({"timestep": 0.0}, "greater than 0"),
    ],
)
def test_what_the_file_says_is_not_said_again(tmp_path, more, said):
    (tmp_path / "run.dump").write_text(write_dump([simple()], "metal"))
    with pytest.raises(AtcError, match=said):
        atc.read(tmp_path / "run.dump", **more)[0]
    same = atc.read(tmp_path / "run.dump", cell=[10.0] * 3, pbc="ppp")[0]
    assert same.cell == atc.read(tmp_path / "run.dump")[0].cell


def test_axes_without_a_cell_are_refused(tmp_path):
    path = write_xyz(tmp_path / "a.xyz", [lattice(jitter=0.4)], comment="")
    with pytest.raises(AtcError, match="give cell, too"):
        atc.read(path, pbc="ppp")[0]


def test_scenes_take_cell_and_step_from_the_script(tmp_path):
    x = lattice(jitter=0.2)
    write_xyz(tmp_path / "run.xyz", [x, x + 0.01], name="1")
    atoms = "".join(f"{k} 1 {p[0]} {p[1]} {p[2]}\n" for k, p in enumerate(x, 1))
    box = "".join(f"0 16 {a}lo {a}hi\n" for a in "xyz")
    (tmp_path / "run.data").write_text(
        f"t\n\n{len(x)} atoms\n1 atom types\n{box}\nMasses\n\n1 39.948\n\nAtoms # atomic\n\n{atoms}"
    )
    (tmp_path / "in.run").write_text(IN)
    scene = Scene.load({"trajectory": {"file": "run.xyz"}, "potential": {"input": "in.run"}})
    scene.folder = tmp_path
    with pytest.warns(AtcWarning, match="its box is not in the file"):
        frame = scene.trajectory()[1]
    assert frame.cell.periodic.tolist() == [True, True, False] and np.allclose(frame.cell.vectors, 16 * np.eye(3))
    assert (frame.masses == 39.948).all() and frame.units.to_user("time", frame.time) == pytest.approx(0.02)
    with pytest.raises(AtcError, match="expected which of the axes"):
        Scene.load({"trajectory": {"file": "run.xyz", "pbc": "ppq"}})
